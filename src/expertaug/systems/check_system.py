"""Checks that a system keeps its contract, before hours of training find out: each mistake is one line.

Every method is called on a few samples, without and with an axis of seeds, and must give a finite tensor of the right
shape and precision, the same when asked twice.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import torch
from torch import Tensor

from expertaug.errors import InputError, SolveError
from expertaug.systems import Parameter, System
from expertaug.systems.settings import EVENTS
from expertaug.systems.solvers.solver import Solver

SAMPLES, SEEDS = 3, 2
TOLERANCE = 1e-4  # relative: a seed's rates alone and beside others are the same to rounding

Ranges = Mapping[str, Sequence[float]]


def check_system(
    system: System,
    where: str = "system",
    z_e: Ranges | None = None,
    z_a: Ranges | None = None,
    simulated: bool = True,
    solver: Solver | None = None,
    step_s: float = 0.01,
) -> None:
    """Call every method of a system and check what it gives.

    Arguments:
        system: to be checked.
        where: file or key, for messages.
        z_e: range of every expert parameter over all sets and priors; their scales without.
        z_a: range of every interaction parameter, likewise.
        simulated: whether the data are simulated, so that truth and a sampler are needed.
        solver: of the training; lawson4 needs the linear part's flow.
        step_s: between two data times, in s.

    Raises:
        InputError: the first mistake: class, method, what was found and what would be right.
    """
    name = type(system).__name__
    _check_attributes(system, where, simulated)
    check_ranges(system.expert_parameters, z_e, where, name)
    check_ranges(system.interaction_parameters, z_a, where, name)
    generator = torch.Generator().manual_seed(0)
    parameters = _samples(system.expert_parameters, z_e, generator)
    latent = _samples(system.interaction_parameters, z_a, generator)
    y0 = torch.rand(SAMPLES, *system.state_shape, generator=generator, dtype=torch.float64)
    if simulated:
        y0 = _check_sampler(system, where)
    inputs = _check_inputs(system, where, simulated, generator)
    if system.has_events:
        _check_events(system, where, y0, parameters, simulated)
        inputs.append(torch.ones(SAMPLES, dtype=torch.float64))  # the side
    for y in (y0, y0.float()):
        z, u = parameters.to(y), [each.to(y) for each in inputs]
        _check(system, where, "expert", (torch.tensor(step_s).to(y), y, z, *u), y)
        if system.has_events:  # a time for each sample
            _check(system, where, "expert", (torch.full((SAMPLES,), step_s).to(y), y, z, *u), y)
        _check(system, where, "initial_state", (y, z), y)
        _check(system, where, "kinematics", (y,), y)
        _check(system, where, "observe", (y,), y, same_shape=False)
        _check(system, where, "features", (y,), y, same_shape=False)
        _check_linear_flow(system, where, y, z, solver, step_s, u)
    _check_gradient(system, where, y0, parameters, inputs)
    if simulated:
        _check(system, where, "truth", (torch.tensor(step_s).to(y0), y0, parameters, latent, *inputs), y0)


def _check_attributes(system: System, where: str, simulated: bool) -> None:
    name = type(system).__name__
    if not isinstance(system, System):
        raise InputError(where, f"{name} is no System", "derive the class from expertaug.systems.System")
    wanted = ("state", "expert_parameters", "inputs", "covariates")
    for attribute in (*wanted, *(("interaction_parameters", "input_parameters") if simulated else ())):
        value = getattr(system, attribute, None)
        if not isinstance(value, tuple) or not all(isinstance(p, Parameter) for p in value):
            remedy = 'give a tuple of Parameter, as (Parameter("x", "m"),)'
            raise InputError(where, f"{name}.{attribute} is {_brief(value)}", remedy)
        names = [p.name for p in value]
        if len(set(names)) < len(names):
            raise InputError(where, f"{name}.{attribute} names {', '.join(names)}", "every name once")
        for parameter in value:
            if not parameter.scale > 0:
                problem = f"{name}.{attribute}: {parameter.name} has the scale {parameter.scale}"
                raise InputError(where, problem, "a scale is its typical magnitude, above 0")
    names = [p.name for p in (*system.state, *system.known)]
    if len(set(names)) < len(names):
        problem = f"{name} names {', '.join(names)} as state, inputs and covariates"
        raise InputError(where, problem, "every name once: an encoder sees all of them")
    if system.interpolation not in ("linear", "constant"):
        raise InputError(where, f"{name}.interpolation is {system.interpolation!r}", "linear or constant")
    if not system.state:
        raise InputError(where, f"{name}.state is empty", "name every component")
    shape = system.state_shape
    if not isinstance(shape, tuple) or not shape or not all(type(n) is int and n > 0 for n in shape):
        raise InputError(where, f"{name}.state_shape is {_brief(shape)}", "give a tuple of whole numbers above 0")
    if shape[0] != len(system.state):
        problem = f"{name}.state_shape is {shape} and state has {len(system.state)} components"
        raise InputError(where, problem, "components come first: (components, *grid)")
    for method in ("truth", "sample_initial_state") if simulated else ():
        if getattr(type(system), method) is getattr(System, method):
            raise InputError(where, f"{name} does not define {method}", "simulated data need it")


def check_ranges(parameters: tuple[Parameter, ...], ranges: Ranges | None, where: str, name: str) -> None:
    """Ranges of a system's parameters; ``name`` is its class's.

    Raises:
        InputError: one is missing or empty, or goes below 0 where the parameter is positive.
    """
    if not ranges:
        return
    for parameter in parameters:
        if parameter.name not in ranges:
            raise InputError(where, f"no range for {name}'s {parameter.name}", "give [min, max]")
        low, high = ranges[parameter.name]
        if not low <= high:
            raise InputError(where, f"the range of {parameter.name} is [{low}, {high}]", "min must not exceed max")
        if parameter.positive and low < 0:
            remedy = "narrow the range, or declare the parameter with positive=False"
            raise InputError(where, f"{parameter.name} of {name} is positive and its range starts at {low:g}", remedy)


def _samples(parameters: tuple[Parameter, ...], ranges: Ranges | None, generator: torch.Generator) -> Tensor:
    """(SAMPLES, P) within the ranges, or between half and one and a half of the scales."""
    ends = [(ranges or {}).get(p.name, (0.5 * p.scale, 1.5 * p.scale)) for p in parameters]
    low, high = (torch.tensor([float(end[k]) for end in ends], dtype=torch.float64) for k in (0, 1))
    return low + (high - low) * torch.rand(SAMPLES, len(parameters), generator=generator, dtype=torch.float64)


def _check_sampler(system: System, where: str) -> Tensor:
    name = f"{type(system).__name__}.sample_initial_state"

    def drawn(n: int) -> Tensor:
        return _call(lambda: system.sample_initial_state(n, torch.Generator().manual_seed(1)), where, name)

    first = drawn(SAMPLES)
    expected = (SAMPLES, *system.state_shape)
    _check_tensor(first, expected, torch.float64, where, name)
    if not torch.equal(first, drawn(SAMPLES)):
        raise InputError(where, f"{name} gives other states for the same generator", "draw with generator=generator")
    _check_tensor(drawn(1), (1, *system.state_shape), torch.float64, where, name)
    return first


def _check_inputs(system: System, where: str, simulated: bool, generator: torch.Generator) -> list[Tensor]:
    """Known inputs (SAMPLES, U) at one time, of their typical size, in a list; an empty one for a system without."""
    if not system.known:
        return []
    name = f"{type(system).__name__}.input_signal"
    if simulated and type(system).input_signal is not System.input_signal:
        parameters, t = _samples(system.input_parameters, None, generator), torch.arange(4, dtype=torch.float64)
        signal = _call(lambda: system.input_signal(t, parameters), where, name)
        _check_tensor(signal, (SAMPLES, len(t), len(system.inputs)), torch.float64, where, name)
    return [_samples(system.known, None, generator)]


def _check_events(system: System, where: str, y: Tensor, z_e: Tensor, simulated: bool) -> None:
    name = type(system).__name__
    if len(system.state_shape) > 1:
        raise InputError(where, f"{name} has events and states of shape {system.state_shape}", "no field has events")
    if simulated and system.simulation.method != EVENTS:
        problem = f"{name} has events, and its simulation is by {system.simulation.method}"
        raise InputError(where, problem, f'simulation = Solver("{EVENTS}", substeps=20) stops at them')
    for states in (y, y.float()):
        z = z_e.to(states)
        value = _call(lambda: system.event(states, z), where, f"{name}.event")  # noqa: B023
        _check_tensor(value, tuple(states.shape[:-1]), states.dtype, where, f"{name}.event")
        _check(system, where, "jump", (states, z), states)


def _check(
    system: System, where: str, method: str, arguments: tuple[Tensor, ...], like: Tensor, same_shape: bool = True
) -> None:
    """One method on samples, with and without an axis of seeds in all of its arguments but the time."""
    name = f"{type(system).__name__}.{method}"
    call = getattr(system, method)
    alone = _call(lambda: call(*arguments), where, name)
    _check_tensor(alone, tuple(like.shape) if same_shape else None, like.dtype, where, name)
    if not same_shape and tuple(alone.shape[:1]) != (SAMPLES,):
        raise InputError(where, f"{name} gives shape {tuple(alone.shape)}", f"begin with the samples, ({SAMPLES}, …)")
    again = _call(lambda: call(*arguments), where, name)
    if not torch.equal(alone, again):
        remedy = "nothing in it may be random or change from call to call"
        raise InputError(where, f"{name} gives other values when called twice", remedy)
    first = _call(lambda: call(*(a if a.dim() == 0 else a[:1] for a in arguments)), where, name, " for one sample")
    if not _close(first, alone[:1]):
        raise InputError(where, f"{name} mixes samples", "every sample's values depend on that sample alone")
    stacked = [a if a.dim() == 0 else a.expand(SEEDS, *a.shape) for a in arguments]
    group = _call(lambda: call(*stacked), where, name, " with an axis of seeds before the samples")
    if tuple(group.shape) != (SEEDS, *alone.shape):
        problem = f"{name} gives shape {_shape(group)} for {SEEDS} seeds"
        remedy = f"give {(SEEDS, *alone.shape)}: index components from the end, as y[..., 0] or y.unbind(-1)"
        raise InputError(where, problem, remedy)
    if not _close(group, alone.expand_as(group)):
        raise InputError(where, f"{name} mixes seeds", "every sample's values depend on that sample alone")


def _check_linear_flow(
    system: System, where: str, y: Tensor, z_e: Tensor, solver: Solver | None, step_s: float, u: Sequence[Tensor]
) -> None:
    """The flow of the linear part, and that nonlinear is the rest: their sum is the expert."""
    name = f"{type(system).__name__}.linear_flow"
    flow = _call(lambda: system.linear_flow(z_e, step_s), where, name, tensor=False)
    if flow is None:
        if solver is not None and solver.splits and type(system).nonlinear is not System.nonlinear:
            raise InputError(where, f"{name} gives None, and nonlinear leaves a part out", "define both or neither")
        return
    moved = _call(lambda: flow(y), where, name)
    _check_tensor(moved, tuple(y.shape), y.dtype, where, name)
    _check(system, where, "nonlinear", (torch.tensor(step_s).to(y), y, z_e, *u), y)
    if y.dtype != torch.float64:
        return
    # Two small steps tell dy/dt = L y up to the second order of the step.
    h, t = 1e-3 * step_s, torch.tensor(step_s).to(y)
    ahead, back = (_call(partial(_flow, system, z_e, s, y), where, name) for s in (h, -h))
    linear = (ahead - back) / (2 * h)
    rest = system.expert(t, y, z_e, *u) - system.nonlinear(t, y, z_e, *u)
    if not torch.allclose(linear, rest, rtol=1e-2, atol=1e-2 * float(rest.abs().max()) + 1e-8):
        remedy = "expert(t, y, z_e) = L y + nonlinear(t, y, z_e), and linear_flow(z_e, h) is exp(h L)"
        raise InputError(where, f"{name} and nonlinear do not add up to expert", remedy)


def _check_gradient(system: System, where: str, y: Tensor, z_e: Tensor, u: Sequence[Tensor]) -> None:
    """Training goes through the expert: its rates must carry the gradient of z_e, or start where z_e says."""
    name = f"{type(system).__name__}.expert"
    z = z_e.clone().requires_grad_()
    time = torch.tensor(0.0).to(y)
    outputs = _call(lambda: torch.stack((system.expert(time, y, z, *u), system.initial_state(y, z))), where, name)
    if not outputs.requires_grad:
        remedy = "compute with torch on z_e itself: no numpy, no .item(), no .detach()"
        raise InputError(where, f"{name} does not depend on z_e, or loses its gradient", remedy)
    (gradient,) = torch.autograd.grad(outputs.sum(), z)
    if not torch.isfinite(gradient).all():
        raise InputError(where, f"{name} has a gradient by z_e that is not finite", "avoid √ and division at 0")


def _call(call: Callable, where: str, name: str, how: str = "", tensor: bool = True) -> Any:
    """What a method gives; any exception as one line, and anything that is no tensor refused."""
    try:
        result = call()
    except (InputError, SolveError):
        raise
    except Exception as error:
        raise InputError(where, f"{name} fails{how} ({type(error).__name__}: {error})", "correct the class") from error
    if tensor and not isinstance(result, Tensor):
        raise InputError(where, f"{name} gives {_brief(result)}", "give a torch tensor, not numpy or a number")
    return result


def _check_tensor(tensor: Tensor, shape: tuple[int, ...] | None, dtype: torch.dtype, where: str, name: str) -> None:
    if shape is not None and tuple(tensor.shape) != shape:
        raise InputError(where, f"{name} gives shape {tuple(tensor.shape)}", f"give {shape}: (samples, *state)")
    if tensor.dtype != dtype:
        remedy = f"give {dtype}: make constants with the states' precision, as torch.zeros_like(y) or y.new_tensor(…)"
        raise InputError(where, f"{name} gives {tensor.dtype} for {dtype}", remedy)
    if not torch.isfinite(tensor).all():
        raise InputError(where, f"{name} gives a value that is not finite", "check it at typical states and parameters")


def _close(actual: Tensor, expected: Tensor) -> bool:
    if actual.shape != expected.shape:
        return False
    size = float(expected.abs().max()) if expected.numel() else 0.0
    return torch.allclose(actual, expected, rtol=TOLERANCE, atol=TOLERANCE * size)


def _brief(value: object) -> str:
    return f"{type(value).__name__} {value!r}" if isinstance(value, int | float | str | tuple) else type(value).__name__


def _shape(value: Tensor) -> str:
    return str(tuple(value.shape))


def _flow(system: System, z_e: Tensor, h: float, y: Tensor) -> Tensor:
    """y after h s of the linear part alone."""
    flow = system.linear_flow(z_e, h)
    return y if flow is None else flow(y)
