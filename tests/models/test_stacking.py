"""One module that computes a group of seeds: its tensors are those of all, and each seed is on its own."""

from __future__ import annotations

import copy

import pytest
import torch
from torch import nn

from expertaug.errors import InputError
from expertaug.models.stacking import SeedWise, is_stackable, select, stack


class Tied(nn.Module):
    """Two names of one weight, beside a running average."""

    def __init__(self):
        super().__init__()
        self.first, self.average = nn.Linear(2, 2, bias=False), nn.BatchNorm1d(2)
        self.second = self.first


def test_a_stack_has_the_tensors_of_all_along_a_leading_axis_and_seeds_are_selected_from_it():
    models = [Tied() for _ in range(3)]
    weights = [model.first.weight.detach().clone() for model in models]
    models[1].average.running_mean += 1
    group = stack(models)
    assert torch.equal(group.first.weight, torch.stack(weights)) and group.second.weight is group.first.weight
    assert group.average.running_mean.tolist() == [[0, 0], [1, 1], [0, 0]]
    some = select(group, [1, 0], 3)
    assert torch.equal(some.first.weight, torch.stack((weights[1], weights[0])))
    assert some.average.running_mean.tolist() == [[1, 1], [0, 0]] and len(group.first.weight) == 3


@pytest.mark.parametrize("make", [lambda: nn.Linear(2, 4), lambda: nn.GRU(2, 4)], ids=["vmap has a rule", "none"])
def test_a_wrapped_module_gives_what_each_seed_gives_alone(make):
    torch.manual_seed(0)
    modules, x = [make() for _ in range(3)], torch.randn(5, 2)
    alone = [copy.deepcopy(module)(x) for module in modules]
    group = stack([SeedWise(module, "model.encoder") for module in modules])

    def tensor(result):
        return (result if isinstance(result, torch.Tensor) else result[0],)

    (found,) = group.each("forward", [x], [None], tensor)
    torch.testing.assert_close(found, torch.stack([tensor(result)[0] for result in alone]))


def test_lazy_and_random_layers_are_refused():
    with pytest.raises(InputError, match="is a lazy layer's"):
        stack([nn.LazyLinear(2), nn.LazyLinear(2)])
    group = stack([SeedWise(nn.Dropout(0.5).train(), "model.encoder") for _ in range(2)])
    group.module.register_parameter("weight", nn.Parameter(torch.ones(2, 1)))  # in training, its mode is kept
    with pytest.raises(InputError, match=r"model\.encoder: Dropout draws random numbers"):
        group.each("forward", [torch.ones(5, 2)], [None], lambda result: (result,))


def test_a_subclass_does_not_inherit_that_it_computes_stacked_parameters():
    class Ours(nn.Module):
        stackable = True

    class Theirs(Ours):
        pass

    assert is_stackable(Ours()) and not is_stackable(Theirs())
