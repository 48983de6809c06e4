"""Kinds of estimators: what each can do, how it is made where no gradient step trains it, and how a file holds it.

A method of the configuration, and a model file, names its kind by a short name or as ``package.module:Class``.  Nobody
compares names: what a kind can do stands here, an attribute each.  A new kind is a subclass of :class:`EstimatorKind`
with :meth:`~EstimatorKind.fit` and :meth:`~EstimatorKind.network`.  torch is not loaded here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

from expertaug.errors import InputError
from expertaug.models.card import ModelCard
from expertaug.registry import Part, find
from expertaug.settings import Settings
from expertaug.wording import suggest

if TYPE_CHECKING:
    from torch import Tensor, nn

    from expertaug.systems import System
    from expertaug.trajectories import Trajectories

Classes = Mapping[str, Callable]

ESTIMATORS: dict[str, type[EstimatorKind]] = {}  # by short name
ESTIMATOR = Part("kind of estimators", {}, f"{__name__}:EstimatorKind", needed="network", given=())


class EstimatorKind:
    """A kind of estimators; its defaults are those of one that no gradient step trains and that has no expert.

    Attributes:
        name: by which a configuration and a file name it; empty: as ``package.module:Class``.
        summary: what it is, for the configuration's reference.
        is_method: whether methods of a configuration may be of this kind.
        stage: which makes its model files.
        parts: networks that it learns by gradient steps, of encoder and interaction; its tensors have the seeds first.
        has_objective: whether an objective trains it, so that it can be trained on: augmented, or as a control.
        has_expert: whether it estimates the parameters of an expert, which fits of a window then refine.
        fits_windows: whether its estimates are least squares on each window, which a range of p⁺ starts and which cost
            hundreds of forecasts a window; otherwise one pass, from which such fits can start.
        shares: whether expert parameters that the configuration calls shared are fitted once, to all training windows
            together; otherwise each window has its own.
        fixed_times: whether it forecasts at the times of its training alone.
        training: class of the settings that its training is told, as the module that defines them says; None: it is not
            loaded.
        needs: keys that its card must have.
        base: beginning of the names of the tensors of the model that it stands beside (:attr:`ModelCard.base`); empty:
            it stands alone.
    """

    name: ClassVar[str] = ""
    summary: ClassVar[str] = ""
    is_method: ClassVar[bool] = True
    stage: ClassVar[str] = "train"
    parts: ClassVar[tuple[str, ...]] = ()
    has_objective: ClassVar[bool] = False
    has_expert: ClassVar[bool] = False
    fits_windows: ClassVar[bool] = False
    shares: ClassVar[bool] = False
    fixed_times: ClassVar[bool] = False
    training: ClassVar[type[Settings] | None] = None
    needs: ClassVar[tuple[str, ...]] = ()
    base: ClassVar[str] = ""

    @classmethod
    def trains(cls) -> bool:
        """Whether gradient steps train it."""
        return bool(cls.parts)

    @classmethod
    def is_classical(cls) -> bool:
        """Whether it fits the expert to each window and learns nothing."""
        return cls.fits_windows and not cls.parts

    @classmethod
    def fit(
        cls, system: System, train: Trajectories, card: ModelCard, truth: bool = False
    ) -> tuple[nn.Module, ModelCard]:
        """The model of a training set, and what its file says: of a kind that no gradient step trains.

        Arguments:
            card: with what is known of data and options.
            truth: whether the equation that made the data takes the expert's place.

        Raises:
            InputError: of these data there is none.
        """
        raise InputError("build.kind", f"{cls.name or cls.__name__} has no fit", "define it, or train by a stage")

    @classmethod
    def network(
        cls, system: System, card: ModelCard, tensors: Mapping[str, Tensor], classes: Classes, base: Any = None
    ) -> nn.Module:
        """The model that a file describes, before its tensors are loaded.

        Arguments:
            tensors: of the file, by name; for their shapes alone.
            classes: that are not this package's, by the name that the card gives them.
            base: the model that it stands beside, of a kind with :attr:`base`.
        """
        raise NotImplementedError


Kind = TypeVar("Kind", bound=type[EstimatorKind])


def register(kind: Kind) -> Kind:
    """A class, known by its short name from now on."""
    ESTIMATORS[kind.name] = kind
    return kind


def estimator(kind: str, where: str = "kind", classes: Classes | None = None) -> type[EstimatorKind]:
    """The class of a kind.

    Arguments:
        kind: a short name, or ``package.module:Class``.
        where: for messages.
        classes: by name, instead of what importing the name would give.

    Raises:
        InputError: there is none.
    """
    if kind in ESTIMATORS:
        return ESTIMATORS[kind]
    if ":" not in kind:
        raise InputError(
            where, f"'{kind}' is no {ESTIMATOR.name}", f"{suggest(kind, ESTIMATORS)}, or package.module:Class"
        )
    return (classes or {}).get(kind) or find(ESTIMATOR, kind, where)  # type: ignore[return-value]


def methods() -> list[str]:
    """Short names of the kinds that a method may be of."""
    return [name for name, kind in ESTIMATORS.items() if kind.is_method]


@register
class Hybrid(EstimatorKind):
    """An encoder, an expert and an interaction model, trained together."""

    name = "hybrid"
    summary = "an encoder, an expert and an interaction model"
    parts = ("encoder", "interaction")
    has_objective = has_expert = True

    @classmethod
    def network(
        cls,
        system: System,
        card: ModelCard,
        tensors: Mapping[str, Tensor] | None = None,
        classes: Classes | None = None,
        base: Any = None,
    ) -> nn.Module:
        """Stacked, one initialisation a seed."""
        import torch

        from expertaug.models import describe

        times = torch.tensor(card.t[: card.observed], dtype=torch.float64)
        recipe = describe.recipe_of(system, card, classes)
        model = recipe.build(times, card.seeds, bool(card.likelihood), card.start)
        if card.training.bound_z_a and tensors is not None:
            from expertaug.models.decoder import LatentBound

            ends = [tensors.get(f"decoder.latent_bound.{end}") for end in ("least", "most")]
            if any(end is None for end in ends):
                raise InputError("model file", "does not hold the bound of its z_a", "make it again")
            model.decoder.latent_bound = LatentBound(*map(torch.empty_like, ends))
        return model


@register
class SharedHybrid(Hybrid):
    """The same with constants in place of what windows share (:mod:`expertaug.models.shared_parameters`)."""

    name = "hybrid_shared"
    summary = "the same with constants, which are learned with it, for what refinement.units calls shared"
    shares = True


@register
class Alternating(EstimatorKind):
    """An interaction model learned without an encoder, from fits of each window."""

    name = "alternating"
    summary = "an expert and an interaction model, learned from fits to each window, without an encoder"
    stage = "alternate"
    training = None
    parts = ("interaction",)
    has_expert = fits_windows = True

    @classmethod
    def network(
        cls, system: System, card: ModelCard, tensors: Mapping[str, Tensor], classes: Classes, base: Any = None
    ) -> nn.Module:
        from expertaug.models import describe

        return describe.decoder_of(system, card, classes)


@register
class SharedAlternating(Alternating):
    """The same where windows share parameters, which its file keeps (:mod:`expertaug.inference.held_constants`)."""

    name = "alternating_shared"
    summary = "the same with what windows share, as refinement.units, population and sensors say"
    shares = True


@register
class LeastSquares(EstimatorKind):
    """The expert alone, or the equation that made the data, fitted to each window."""

    name = "least_squares"
    summary = "the expert alone, fitted to each window, without a network"
    has_expert = fits_windows = True

    @classmethod
    def fit(
        cls, system: System, train: Trajectories, card: ModelCard, truth: bool = False
    ) -> tuple[nn.Module, ModelCard]:
        """The decoder, whose estimates are to be found by least squares; nothing is trained.

        Raises:
            InputError: the true equation of data that were not simulated.
        """
        from expertaug.models.decoder import Decoder, TruthDecoder

        card = card.but(model=None, expert=True, interaction=False)
        if not truth:
            return Decoder(system), card
        z_a = train.z_a
        if z_a is None or not z_a.shape[1]:
            raise InputError("build.truth", "the training set has no z_a", "only simulated data have a true equation")
        latent = {"mean": [z_a.mean(0).tolist()], "std": [z_a.std(0).tolist()]}
        return TruthDecoder(system), card.but(truth=True, latent=latent)

    @classmethod
    def network(
        cls, system: System, card: ModelCard, tensors: Mapping[str, Tensor], classes: Classes, base: Any = None
    ) -> nn.Module:
        from expertaug.models.decoder import Decoder, TruthDecoder

        return TruthDecoder(system) if card.truth else Decoder(system)


@register
class SharedLeastSquares(LeastSquares):
    """The same where windows share parameters, which its file keeps (:mod:`expertaug.inference.shared`)."""

    name = "least_squares_shared"
    summary = "the same with what windows share, as refinement.units, population and sensors say"
    stage = "share"
    shares = True


@register
class Mean(EstimatorKind):
    """The paper's simplest baseline: the mean of the training signals."""

    name = "mean"
    summary = "forecasts the mean of the training set"
    fixed_times = True

    @classmethod
    def fit(
        cls, system: System, train: Trajectories, card: ModelCard, truth: bool = False
    ) -> tuple[nn.Module, ModelCard]:
        """The mean (T, *state), with straight lines over the gaps of each signal; of a component that nobody measured
        0."""
        import torch

        from expertaug.models.decoder import MeanModel
        from expertaug.windows import fill

        y = torch.from_numpy(train.y)
        if train.mask is None or train.mask.all():
            return MeanModel(system, y.mean(0)), card
        filled = fill(torch.from_numpy(train.seen).movedim(1, 0), torch.from_numpy(train.t), y.new_zeros(y.shape[2:]))
        measured = torch.from_numpy(train.mask).any(1)  # of a signal's component
        return MeanModel(system, torch.where(measured, filled, 0.0).sum(1) / measured.sum(0).clamp_min(1)), card

    @classmethod
    def network(
        cls, system: System, card: ModelCard, tensors: Mapping[str, Tensor], classes: Classes, base: Any = None
    ) -> nn.Module:
        from expertaug.models.decoder import MeanModel

        return MeanModel(system, tensors["mean"])
