"""A network's outputs, their derivatives and their gradients are those of backpropagation."""

from itertools import pairwise

import pytest
import torch

from expertaug.models.networks import linearised as module
from expertaug.models.networks.layers import ACTIVATIONS, affine
from expertaug.models.networks.linearised import linearised

WIDTHS = (3, 6, 5, 2)


def network(shared):
    generator = torch.Generator().manual_seed(1)

    def random(*shape):
        return torch.randn(*shape, generator=generator, dtype=torch.float64).requires_grad_()

    layers = [(random(2, a, b), random(2, 1, b)) for a, b in pairwise(WIDTHS)]
    if not shared:
        layers[0] = (layers[0][0], random(2, 7, WIDTHS[1]))
    return random(2, 7, WIDTHS[0]), layers


@pytest.mark.parametrize("activation", ACTIVATIONS)
@pytest.mark.parametrize("numbers", [10**6, 40])
@pytest.mark.parametrize("shared", [True, False])
def test_as_by_backpropagation(activation, numbers, shared, monkeypatch):
    monkeypatch.setattr(module, "NUMBERS", numbers)
    (x, layers), act = network(shared), ACTIVATIONS[activation]
    hidden = x
    for weight, bias in layers[:-1]:
        hidden = act(affine(hidden, weight, bias))
    expected = affine(hidden, *layers[-1])
    value, slopes = linearised(x, layers, act, (0, 1))
    assert torch.allclose(value, expected)
    for k in range(2):
        (slope,) = torch.autograd.grad(expected[..., k].sum(), x, retain_graph=True)
        assert torch.allclose(slopes[k], slope)
    assert not slopes.requires_grad
    flat = [tensor for layer in layers for tensor in layer]
    factor = torch.randn_like(value)
    for a, b in zip(
        torch.autograd.grad((value * factor).sum(), flat),
        torch.autograd.grad((expected * factor).sum(), flat),
        strict=True,
    ):
        assert torch.allclose(a, b)


def test_only_the_outputs_that_are_asked_for_have_gradients():
    x, layers = network(True)
    value, slopes = linearised(x, layers, ACTIVATIONS["silu"], (1,))
    first = layers[0][0]
    (found,) = torch.autograd.grad(value[..., 1].sum(), first)
    assert slopes.shape == (1, 2, 7, 3) and found.abs().sum() > 0
