"""One module that computes a group of seeds: parameters and buffers gain a leading seed axis.

Modules made of this package's layers compute stacked parameters as they are, and say so by ``stackable = True`` in
their own class body (a subclass may do other things, so it does not inherit that).  Any other module is called through
:class:`SeedWise`, which gives it one seed's tensors at a time: by torch.vmap, or, for one seed and where a layer has no
rule for that (torch.nn.GRU, spectral_norm), one seed after the other.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from typing import TypeVar

import torch
from torch import Tensor, nn
from torch.func import functional_call, vmap
from torch.nn.parameter import is_lazy

from expertaug.errors import InputError

RANDOM = "draws random numbers, which cannot be reproduced for each seed"
WITHOUT_RANDOM = "leave random layers such as dropout out"
Parts = tuple[Tensor | None, ...]
State = dict[str, Tensor]  # parameters or buffers by name
Network = TypeVar("Network", bound=nn.Module)


def is_stackable(part: nn.Module) -> bool:
    """Whether a module's own class says that it computes stacked parameters."""
    return vars(type(part)).get("stackable", False) is True


def stack(models: Sequence[Network]) -> Network:
    """The first of equal modules, one a seed, with the parameters and buffers of all along a leading axis.

    Raises:
        InputError: a layer has no parameters before its first call.
    """
    stacked = models[0]
    tensors = [_tensors(model) for model in models]
    made: dict[int, Tensor] = {}  # what two names share stays shared
    for name, value in list(tensors[0].items()):
        if is_lazy(value):
            raise InputError(name, "is a lazy layer's, without a shape yet", "give its number of inputs")
        owner = stacked.get_submodule(name.rpartition(".")[0])
        leaf = name.rpartition(".")[2]
        parameter = leaf in owner._parameters
        if id(value) not in made:
            each = torch.stack([t[name].detach() for t in tensors])
            made[id(value)] = nn.Parameter(each, value.requires_grad) if parameter else each
        (owner._parameters if parameter else owner._buffers)[leaf] = made[id(value)]
    for module in stacked.modules():
        if isinstance(module, SeedWise):
            module.seeds = len(models)
    return stacked


def select(model: Network, places: Sequence[int], count: int) -> Network:
    """A model of the seeds at some places of a group; the group's own stays as it is.

    Arguments:
        model: stacked over ``count`` seeds, the leading axis of its parameters and buffers; a model without parameters
            is the same for all seeds.
        places: from 0.
    """
    chosen = copy.deepcopy(model)
    if not any(True for _ in model.parameters()):
        return chosen
    index = torch.tensor(list(places), dtype=torch.long)
    for module in chosen.modules():
        for name, value in module._parameters.items():
            if value is not None:
                kept = value.detach()[index.to(value.device)].clone()
                module._parameters[name] = nn.Parameter(kept, requires_grad=value.requires_grad)
        for name, value in module._buffers.items():
            if value is not None:
                module._buffers[name] = value[index.to(value.device)].clone()
        if getattr(module, "seeds", None) == count:  # a wrapped module counts them
            vars(module)["seeds"] = len(index)
    return chosen


def _tensors(model: nn.Module) -> dict[str, Tensor]:
    return dict(model.named_parameters(remove_duplicate=False)) | dict(model.named_buffers(remove_duplicate=False))


class SeedWise(nn.Module):
    """A module that knows nothing of seeds, computing one or a group of them.

    Its mode is that of training where a step may change it: in training, with gradients, and not frozen.  What it
    keeps in buffers (spectral_norm, running averages) then changes, and never in a forecast.

    Arguments:
        module: of one seed; :func:`stack` gives it the tensors of all.
        where: the configuration's key, for messages.

    Attributes:
        seeds: how many are stacked; None for one that is not.
    """

    def __init__(self, module: nn.Module, where: str) -> None:
        super().__init__()
        self.module, self.where = module, where
        self.seeds: int | None = None
        self._vectorised: dict[tuple[str, bool], bool] = {}  # by method and mode, known after a first call
        self.__dict__["_caller"] = _Caller(module)  # hidden: its parameters are the module's

    @property
    def name(self) -> str:
        return type(self.module).__name__

    def each(
        self,
        method: str,
        arguments: Sequence[Tensor],
        axes: Sequence[int | None],
        finish: Callable[[object], Parts] = lambda _: (),
    ) -> Parts:
        """Call a method for every seed.

        Arguments:
            method: its name.
            arguments: of all seeds.
            axes: which axis of each argument is the seeds'; None for an argument that all seeds share.
            finish: makes tensors of what the method returned for one seed.

        Returns:
            these tensors, with the seeds as first axis where the module is stacked.

        Raises:
            InputError: the module draws random numbers.
        """
        fitting = method == "fit"
        training = fitting or (
            self.training and torch.is_grad_enabled() and any(p.requires_grad for p in self.module.parameters())
        )
        if self.module.training != training:
            self.module.train(training)
        if self.seeds is None:
            return finish(getattr(self.module, method)(*arguments))
        parameters, buffers = dict(self.module.named_parameters()), dict(self.module.named_buffers())

        def one(parameters: State, buffers: State, *arguments: Tensor) -> tuple[Parts, dict[str, Tensor]]:
            own = {f"module.{k}": v for k, v in (parameters | buffers).items()}
            returned, after = functional_call(self.__dict__["_caller"], own, (method, *arguments))
            return finish(returned), after

        outcome, way = None, (method, training)
        if fitting or self.seeds == 1:  # of one seed, vmap costs twice a plain call
            self._vectorised[way] = False
        if way not in self._vectorised:
            kept = {k: v.clone() for k, v in buffers.items()}
            try:
                outcome = self._at_once(one, parameters, buffers, arguments, axes)
                self._vectorised[way] = True
            except InputError:
                raise
            except Exception as error:  # a layer without a rule; what is the module's own fault comes up again below
                if "randomness error mode" in str(error):
                    raise InputError(self.where, f"{self.name} {RANDOM}", WITHOUT_RANDOM) from error
                self._vectorised[way] = False
                for name, value in kept.items():
                    buffers[name].copy_(value)
        elif self._vectorised[way]:
            outcome = self._at_once(one, parameters, buffers, arguments, axes)
        result, after = outcome or self._in_turn(one, parameters, buffers, arguments, axes)
        if training:
            for name, value in after.items():
                owner, _, leaf = name.rpartition(".")
                self.module.get_submodule(owner)._buffers[leaf] = value.detach()
        return result

    def _at_once(self, function: Callable, *arguments: object) -> tuple[Parts, dict[str, Tensor]]:
        *state, tensors, axes = arguments
        static: list[Parts] = []

        def call(*values: object) -> tuple:
            parts, after = function(*values)
            static.append(parts)
            return tuple(value for value in parts if value is not None), after

        outputs, after = vmap(call, in_dims=(0, 0, *axes), randomness="error")(*state, *tensors)
        rest = iter(outputs)
        return tuple(None if value is None else next(rest) for value in static[0]), after

    def _in_turn(
        self,
        function: Callable,
        parameters: State,
        buffers: State,
        arguments: Sequence[Tensor],
        axes: Sequence[int | None],
    ) -> tuple[Parts, dict[str, Tensor]]:
        before = torch.get_rng_state()
        parameters = {k: v.unbind(0) if torch.is_grad_enabled() else v for k, v in parameters.items()}
        each = []
        for seed in range(self.seeds or 1):
            own = [{k: v[seed] for k, v in tensors.items()} for tensors in (parameters, buffers)]
            taken = [x if axis is None else x.select(axis, seed) for x, axis in zip(arguments, axes, strict=True)]
            each.append(function(*own, *taken))
        if not torch.equal(before, torch.get_rng_state()):
            raise InputError(self.where, f"{self.name} {RANDOM}", WITHOUT_RANDOM)
        stacked = tuple(
            None if values[0] is None else torch.stack(values) for values in zip(*(e[0] for e in each), strict=True)
        )
        return stacked, {k: torch.stack([e[1][k] for e in each]) for k in each[0][1]}


class _Caller(nn.Module):
    """Calls a method of a module by name, and tells what its buffers are afterwards."""

    def __init__(self, module: nn.Module) -> None:
        super().__init__()
        self.module = module

    def forward(self, method: str, *arguments: Tensor) -> tuple[object, dict[str, Tensor]]:
        call = self.module if method == "forward" else getattr(self.module, method)
        return call(*arguments), dict(self.module.named_buffers())
