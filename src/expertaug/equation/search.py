"""The search for an equation: candidates from the windows and from F_a, refits, the choice, and the model it makes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from expertaug.equation.library import finite, library, rates_of
from expertaug.equation.network import Learned, describe_learned
from expertaug.equation.result import Coefficient, Found, Row
from expertaug.equation.selection import ROUNDS, Choice, Tried, backward, choose, exchange_terms, forward
from expertaug.equation.shooting import Fit, Formula, Guess, Sample, Shooting
from expertaug.errors import InputError
from expertaug.inference.window_problem import assumed_noise
from expertaug.learning.divergence import bound_of_card, clamp_to_bound
from expertaug.learning.residuals import squared_errors
from expertaug.models.card import LatentRecord, ModelCard
from expertaug.models.decoder import Decoder
from expertaug.models.estimators import Alternating
from expertaug.models.fit_settings import Constant, Refinement, RefinementSettings
from expertaug.models.interactions.equation import EquationInteraction
from expertaug.models.observation_noise import GivenNoise, is_some, noise_of
from expertaug.models.posterior import Estimates, Predictor
from expertaug.models.store import StoredModel
from expertaug.models.terms import Term
from expertaug.systems.solvers.solver import Solver
from expertaug.trajectories import Trajectories
from expertaug.windows import Windows
from expertaug.wording import check_keys

KEPT = ("experiment", "preset", "choices", "t", "observed", "observed_s", "bound", "start", "data_noise", "system")
FEWEST = 3  # points after the observed window
WIDER = 0.5  # of a parameter's range over the training windows, on either side, where fits start
DIRECT = "direct"
EXPERT, NETWORK, EQUATION, BY_HAND = "expert alone", "network", "equation", "by hand"


@dataclass(frozen=True)
class Options:
    """What is sought, and how.

    Attributes:
        extra, only, by_hand: terms beside the library, in its place, and as opponent.
        components: in whose rates; None: those on which F_a acts, or those of :func:`rates_of`.
        kinematics, by_parameters: as of :func:`rates_of` and :func:`library`.
        most: terms of a formula.
    """

    extra: tuple[Term, ...] = ()
    only: tuple[Term, ...] | None = None
    by_hand: tuple[Term, ...] = ()
    components: tuple[str, ...] | None = None
    kinematics: bool = False
    by_parameters: bool = False
    most: int = 8


class Search:
    """All that the search for what one model's expert lacks knows.

    Arguments:
        stored: the model's decoder and card.
        predictor: what estimates and forecasts, as the model is used.
        refinement: how its windows are fitted; None: they are not.
        train, validation: sets of the same times, with points after the observed window.
        units: to what expert parameters belong, where it differs from the refinement's.
        noise: standard deviation of the data's noise; None: the refinement's.
        solver: of the fits; None: the refinement's, or that of training.
        label: of the model that is made.

    Raises:
        InputError: a model without an expert, windows without points to forecast, or an unknown parameter.
    """

    def __init__(
        self,
        stored: StoredModel,
        predictor: Predictor,
        refinement: Refinement | None,
        train: Trajectories,
        validation: Trajectories,
        units: Mapping[str, str] | None = None,
        noise: GivenNoise | None = None,
        solver: Solver | None = None,
        label: str = "Equation",
    ) -> None:
        kind, card = stored.kind, stored.card
        if not kind.has_expert or not stored.model.knows_z_e:
            raise InputError("model", f"{card.label or card.kind} has no expert", "give a model with an expert")
        if len(train.t) - card.observed < FEWEST:
            problem = f"{len(train.t) - card.observed} points after the observed window"
            raise InputError("train", problem, "give windows that go on: validation scores forecasts")
        self.stored, self.predictor, self.refinement = stored, predictor, refinement
        self.system, self.card, self.label, self.observed = stored.model.system, card, label, card.observed
        self.train, self.validation = train, validation
        self.decoder: Decoder = stored.model if kind.fits_windows else stored.model.decoder
        settings = RefinementSettings() if refinement is None else refinement.settings
        set_fields = settings.model_fields_set
        if settings.of_sensors:
            raise InputError("sensors", "are estimated by the model", "leave them out, and seek terms with kinematics")
        names = [p.name for p in self.system.expert_parameters]
        check_keys(units or {}, names, "units", "expert parameter")
        chosen = {**(settings.units or {}), **(units or {})}
        self.units = RefinementSettings.from_mapping({"units": chosen}).shared
        self.own = len(self.units) < len(names) or not names  # of one apparatus every coefficient is one number
        self.noise = noise if noise is not None else 0.0 if refinement is None else refinement.noise
        noise_std = noise_of(self.noise, self.system, card)
        self.assumed, self.noisy = assumed_noise(settings, noise_std, card.bound), is_some(noise_std)
        solver_options = settings.solver if "solver" in set_fields else card.training.solver
        self.solver = Solver(**dict(solver_options or {})) if solver is None else solver
        self.free_start = bool(settings.free_start if "free_start" in set_fields else self.noisy)
        self.samples = [Sample.of(data, self.observed) for data in (train, validation)]
        self.guesses = [self._guess(data) for data in (train, validation)]
        self.states = self._with_fitted(train)

    def candidates(self, options: Options) -> list[Term]:
        """The library and what options say of it."""
        names = [p.name for p in self.system.state]
        if unknown := sorted(set(options.components or ()) - set(names)):
            raise InputError("components", f"names '{unknown[0]}'", f"known: {', '.join(names)}")
        terms = options.only
        if terms is None:
            terms = tuple(library(self.system, self.states, self._rates_with_terms(options), options.by_parameters))
        return list(dict.fromkeys([*terms, *options.extra]))

    def _rates_with_terms(self, options: Options) -> list[str]:
        names = [p.name for p in self.system.state]
        if options.components is not None:
            return [name for name in names if name in options.components]
        acts = getattr(self.decoder.interaction, "acts_on", None)
        if acts is None or options.kinematics:
            return rates_of(self.system, options.kinematics)
        return [name for k, name in enumerate(names) if k in acts]

    @torch.no_grad()
    def run(self, options: Options) -> Found:
        """Select, refit, compare.

        Raises:
            InputError: a term that cannot be used.
        """
        terms, hand, most = self.candidates(options), options.by_hand, options.most
        (train, validation), (first, second) = self.samples, self.guesses
        sizes = self._sizes(terms, hand)
        terms = [term for term in terms if term in sizes]
        self.shooting = Shooting(
            self.system,
            torch.from_numpy(self.train.t),
            self.assumed,
            not self.noisy,
            self.free_start,
            self.solver,
            sizes,
            self.units,
            None if self.card.bound is None else torch.tensor(self.card.bound),
            self.card.start,
            self.own,
        )
        done: dict[frozenset, Tried] = {}

        def judge(fit: Fit, source: str = DIRECT) -> Tried:
            key = frozenset(zip(fit.formula.terms, fit.formula.shared, strict=True))
            if key not in done:
                coefficients = self.shooting.values(fit, train.groups)
                each = [
                    abs(coefficient.value) / max(coefficient.error, 1e-300)
                    for coefficient in coefficients
                    if math.isnan(coefficient.spread)
                ]
                errors = self.shooting.errors(fit, second, validation)
                done[key] = Tried(fit, errors, source, min(each, default=math.inf))
            return done[key]

        def attempt(formula: Formula, guess: Guess, source: str = DIRECT) -> Tried:
            key = frozenset(zip(formula.terms, formula.shared, strict=True))
            return done[key] if key in done else judge(self.shooting.fit(formula, guess, train), source)

        alone = judge(self.shooting.fit(Formula(), first, train))
        backward(attempt, forward(self.shooting, alone, terms, train, most, judge)[-1])
        networks = self._networks(terms)
        for network in networks:
            path = [attempt(formula, alone.fit.guess, NETWORK) for formula in network.formulas(most)]
            if path:
                backward(lambda formula, guess: attempt(formula, guess, NETWORK), path[-1])
        tolerance = 0.0 if self.noisy else self._tolerance()
        for _ in range(ROUNDS):
            choice = choose(list(done.values()), validation.groups, tolerance)
            count = len(done)
            exchange_terms(self.shooting, choice.chosen, terms, train, attempt)
            if len(done) == count:
                break
        choice, tried = choose(list(done.values()), validation.groups, tolerance), list(done.values())
        return self._result(choice, tried, alone, self._by_hand(hand, attempt), networks)

    def _by_hand(self, hand: Sequence[Term], attempt: object) -> Tried | None:
        """The terms that were given, with coefficients that all windows share, or each has its own, whichever
        forecasts better."""
        if not hand:
            return None
        formulas = [Formula(tuple(hand), (shared,) * len(hand)) for shared in (True, *([False] if self.own else []))]
        alone = self.guesses[0]
        return min((attempt(f, alone, BY_HAND) for f in formulas), key=lambda tried: tried.score)  # type: ignore[operator]

    def _result(
        self,
        choice: Choice,
        tried: Sequence[Tried],
        alone: Tried,
        opponent: Tried | None,
        networks: Sequence[Learned],
    ) -> Found:
        shooting, (train, validation) = self.shooting, self.samples
        fit = choice.chosen.fit
        again = shooting.fit(fit.formula, self.guesses[1], validation)
        here, there = shooting.values(fit, train.groups), shooting.values(again, validation.groups)
        short = [set(network.formulas(len(fit.formula.terms))[-1:] or [Formula()]) for network in networks]
        shown = [{term for formula in each for term in formula.terms} for each in short]
        coefficients = tuple(
            Coefficient(
                term,
                shared,
                here[k].value,
                here[k].error,
                here[k].spread,
                there[k].value,
                there[k].error,
                float(np.mean([term in each for each in shown])) if shown else math.nan,
            )
            for k, (term, shared) in enumerate(zip(fit.formula.terms, fit.formula.shared, strict=True))
        )
        count = train.count

        def row(name: str, candidate: Tried) -> Row:
            return Row(
                name, str(candidate.formula), math.log(max(candidate.score, 1e-300)), candidate.formula.freedom(count)
            )

        rows = [row(EXPERT, alone)]
        if self.decoder.interaction is not None:
            rows.append(Row(NETWORK, "F_a", self._network_score(), None))
        rows.append(row(EQUATION, choice.chosen))
        if opponent is not None:
            rows.append(row(BY_HAND, opponent))
        return Found(
            coefficients,
            shooting.constants(fit, train.groups),
            tuple(rows),
            tuple(sorted(tried, key=lambda candidate: candidate.score)),
            tuple(str(candidate.formula) for candidate in choice.ties),
            float(np.mean([network.explained(fit.formula) for network in networks])) if networks else math.nan,
            self._model(fit, self.label),
        )

    def _network_score(self) -> float:
        """log-MSE of the model's own forecasts of the validation windows, the mean of its seeds."""
        windows, observed = self._windows(self.validation), self.observed
        estimates = self.predictor.estimate(windows.until(observed))
        states = self.predictor.predicted(estimates, windows.observed(observed), self.stored.solver)
        states = clamp_to_bound(states, bound_of_card(self.card, states.device))
        errors = squared_errors(self.system, states[observed:], windows.y[observed:])
        return float(errors.nanmean(1).log().mean())

    def _model(self, fit: Fit, label: str) -> StoredModel:
        """Expert and formula as a model whose windows are fitted: shared coefficients are numbers in it, and a window's
        own ones its z_a."""
        formula, card, shooting = fit.formula, self.card, self.shooting
        values = shooting.values(fit, self.samples[0].groups)
        numbers = [coefficient.value if s else None for coefficient, s in zip(values, formula.shared, strict=True)]
        own = [
            (coefficient.value, max(coefficient.spread, 1e-9))
            for coefficient, s in zip(values, formula.shared, strict=True)
            if not s
        ]
        functions = {str(term): term.function for term in formula.terms if term.function is not None}
        part = {"terms": [str(term) for term in formula.terms], "coefficients": numbers}
        interaction = EquationInteraction(self.system, len(own), functions, **part)
        groups = len(set(self.samples[0].groups.tolist()))
        constants = {
            name: Constant(value=value, std=error, groups=groups)
            for name, (value, error) in shooting.constants(fit, self.samples[0].groups).items()
        }
        settings = {"units": dict.fromkeys(self.units, "shared"), "solver": dict(self.solver)}
        refinement = Refinement.of(
            settings=RefinementSettings.from_mapping(settings),
            noise=self.noise,
            prior=self._prior(fit),
            **({"shared": constants} if constants else {}),
        )
        kept = {name: getattr(card, name) for name in KEPT if getattr(card, name) is not None}
        described = ModelCard.of(
            **kept,
            kind=Alternating.name,
            label=label,
            method="equation",
            seeds=[0],
            # What is no text stays as it is, so that a file refuses it.
            model={"interaction": {"kind": "equation", **part, **({"functions": functions} if functions else {})}},
            expert=True,
            interaction=True,
            latent_size=len(own),
            latent=LatentRecord(mean=[[m for m, _ in own]], std=[[s for _, s in own]]),
            training={"solver": dict(self.solver)},
            refinement=refinement,
            forecast_solver=dict(self.stored.solver),
        )
        return StoredModel(Decoder(self.system, interaction).eval(), described, self.stored.classes)

    def _prior(self, fit: Fit) -> dict[str, list[float]]:
        """Range of each expert parameter in which fits start: the model's, or that of the training windows, widened."""
        prior = None if self.refinement is None else self.refinement.prior
        if isinstance(prior, Mapping):
            return {name: list(ends) for name, ends in prior.items()}
        ranges: dict[str, list[float]] = {}
        for k, parameter in enumerate(self.system.expert_parameters):
            low, high = (float(f(fit.guess.z_e[0, :, k])) for f in (torch.min, torch.max))
            wide = WIDER * max(high - low, 0.1 * abs(high), 1e-6 * parameter.scale)
            least = low / 2 if parameter.positive else low - wide
            ranges[parameter.name] = [max(low - wide, least), high + wide]
        return ranges

    def _guess(self, data: Trajectories) -> Guess:
        """The model's own estimates, their median over the seeds."""
        windows = self._windows(data)
        estimates: Estimates = self.predictor.estimate(windows.until(self.observed))
        assert estimates.z_e is not None
        z_e, y0 = (
            v.cpu().double().nan_to_num().median(dim=0, keepdim=True).values for v in (estimates.z_e, estimates.y0)
        )
        return Guess(z_e, y0)

    def _with_fitted(self, data: Trajectories) -> Trajectories:
        """The set with what nobody measured as fits of its windows have it: terms of a speed have a size although only
        angles were measured."""
        if data.mask is None or data.mask.all():
            return data
        windows = self._windows(data)
        estimates = self.predictor.estimate(windows.until(self.observed))
        states = self.predictor.predicted(estimates, windows.observed(self.observed), self.stored.solver)
        fitted = states.cpu().median(dim=1).values.movedim(0, 1).numpy()
        y = np.where(data.mask, data.y, fitted)
        return replace(data, y=y, mask=np.isfinite(y))

    def _windows(self, data: Trajectories) -> Windows:
        return Windows.of(data, self.stored.device).expand(len(self.stored.seeds)).contiguous()

    def _sizes(self, terms: Sequence[Term], hand: Sequence[Term]) -> dict[Term, float]:
        """Typical size of each term's coefficient: of the rate over that of the term, at the training windows."""
        for term in (*terms, *hand):
            term.check(self.system)
        y = torch.from_numpy(self.states.seen).double()
        z_e = self.guesses[0].z_e[0].unsqueeze(1).expand(-1, y.shape[1], -1)
        u = None if self.train.u is None else torch.from_numpy(self.train.u).double()
        good = ~torch.isnan(y.flatten(2)).any(-1)
        sizes = finite(self.system, [*terms, *hand], y[good], z_e[good], None if u is None else u[good])
        if missing := [term for term in hand if term not in sizes]:
            problem = "is zero everywhere or not finite at a state of the training windows"
            raise InputError(f"by_hand: '{missing[0]}'", problem, "write another")
        rates = self._rates()
        names = [p.name for p in self.system.state]
        return {term: float(rates[names.index(term.rate)]) / size for term, size in sizes.items()}

    def _rates(self) -> Tensor:
        """Root mean square of each component's rate over the training windows, (K,)."""
        y = torch.from_numpy(self.states.seen).double()
        step = torch.from_numpy(np.diff(self.train.t)).view(1, -1, *[1] * (y.dim() - 2))
        rate = (y.diff(dim=1) / step).square().movedim(2, 0).flatten(1)
        return rate.nanmean(1).nan_to_num(1.0).clamp_min(1e-12).sqrt()

    def _tolerance(self) -> float:
        """Squared error of forecasts, summed over dimensions, that is none: of noise that fits assume."""
        noise = self.assumed
        each = [float(noise)] * self.system.error_dims if isinstance(noise, int | float) else list(noise)
        return float(np.square(each).sum())

    def _networks(self, terms: Sequence[Term]) -> list[Learned]:
        """What F_a of each seed does; nothing without an F_a."""
        if self.decoder.interaction is None or isinstance(self.decoder.interaction, EquationInteraction):
            return []
        windows = self._windows(self.train)
        estimates = self.predictor.estimate(windows.until(self.observed))
        states = self.predictor.predicted(estimates, windows.observed(self.observed), self.stored.solver)
        shared = [k for k, p in enumerate(self.system.expert_parameters) if p.name in self.units]
        return describe_learned(
            self.decoder, estimates, states, windows.t, windows.u, terms, self._rates(), shared, self.own
        )
