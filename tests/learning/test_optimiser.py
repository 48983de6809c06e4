"""The optimiser is torch's, without the import of torch's compiler."""

import subprocess
import sys

import pytest
import torch

from expertaug.learning.optimiser import Adam


@pytest.mark.parametrize("options", [{"lr": 1e-2}, {"lr": 1e-3, "betas": (0.8, 0.9)}], ids=str)
def test_steps_are_torchs_to_the_bit(options):
    found = []
    for kind in (torch.optim.Adam, Adam):
        generator = torch.Generator().manual_seed(0)
        parameters = [torch.randn(3, 4, generator=generator, requires_grad=True) for _ in range(2)]
        optimiser = kind(parameters, **options)
        for step in range(12):
            if step == 6:  # as a killed training goes on
                state, optimiser = optimiser.state_dict(), kind(parameters, lr=1.0)
                optimiser.load_state_dict(state)
            optimiser.zero_grad(set_to_none=True)
            sum((p.sin() * (k + step)).sum() for k, p in enumerate(parameters)).backward()
            optimiser.step()
        found.append(torch.stack([p.detach() for p in parameters]))
    assert torch.equal(*found)


@pytest.mark.slow
def test_the_compiler_is_not_imported():
    code = """if True:
        import sys, torch
        from expertaug.learning.optimiser import Adam
        p = torch.ones(2, requires_grad=True)
        optimiser = Adam([p])
        p.sum().backward()
        optimiser.step()
        optimiser.zero_grad(set_to_none=True)
        optimiser.load_state_dict(optimiser.state_dict())
        print("torch._dynamo" in sys.modules)
    """
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
