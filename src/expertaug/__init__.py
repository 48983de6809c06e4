"""Robust hybrid learning with expert augmentation (Wehenkel et al., TMLR 2023): a package and a pipeline.

    import expertaug as ea

gives everything that a stage of the pipeline does in memory: :func:`simulate`, :class:`HybridModel`, :func:`fit`,
:func:`augment`, :func:`finetune`, :func:`evaluate`, :func:`load`.  Nothing heavy is imported before it is used; types
stand in ``__init__.pyi``.
"""

from __future__ import annotations

import importlib

__version__ = "1.0.0"  # pyproject.toml takes it from here

# Name → where it is: a module, or module:name.
_EXPORTS = {
    "AdvectionDiffusion": "expertaug.systems.advection_diffusion:AdvectionDiffusion",
    "Aphynity": "expertaug.learning.objectives:Aphynity",
    "AugmentedSets": "expertaug.api.training:AugmentedSets",
    "BouncingBall": "expertaug.systems.bouncing_ball:BouncingBall",
    "ConvEncoder": "expertaug.models.encoders.fields:ConvEncoder",
    "ConvInteraction": "expertaug.models.interactions.convolutional:ConvInteraction",
    "ConvTwoStep": "expertaug.models.encoders.two_step:ConvTwoStep",
    "Comparison": "expertaug.api.compare:Comparison",
    "DampedPendulum": "expertaug.systems.pendulum:DampedPendulum",
    "DampedWave": "expertaug.systems.wave:DampedWave",
    "DampingInteraction": "expertaug.models.interactions.damping:DampingInteraction",
    "DiagonalPropagator": "expertaug.systems.solvers.linear_propagator:DiagonalPropagator",
    "DoublePendulum": "expertaug.systems.double_pendulum:DoublePendulum",
    "DriveInteraction": "expertaug.models.interactions.drive:DriveInteraction",
    "DrivenPendulum": "expertaug.systems.driven_pendulum:DrivenPendulum",
    "Equation": "expertaug.api.explain:Equation",
    "EquationInteraction": "expertaug.models.interactions.equation:EquationInteraction",
    "Forecast": "expertaug.api.forecasts:Forecast",
    "HybridModel": "expertaug.models.hybrid:HybridModel",
    "HybridVAE": "expertaug.learning.hvae:HybridVAE",
    "InputError": "expertaug.errors:InputError",
    "Lorenz": "expertaug.systems.lorenz:Lorenz",
    "LotkaVolterra": "expertaug.systems.lotka_volterra:LotkaVolterra",
    "MLPInteraction": "expertaug.models.interactions.mlp:MLPInteraction",
    "MLPTwoStep": "expertaug.models.encoders.two_step:MLPTwoStep",
    "MomentEncoder": "expertaug.models.encoders.fields:MomentEncoder",
    "Objective": "expertaug.learning.objectives:Objective",
    "Parameter": "expertaug.systems.base:Parameter",
    "PolynomialInteraction": "expertaug.models.interactions.polynomial:PolynomialInteraction",
    "RLC": "expertaug.systems.rlc:RLC",
    "ReactionDiffusion": "expertaug.systems.reaction_diffusion:ReactionDiffusion",
    "RecurrentEncoder": "expertaug.models.encoders.recurrent:RecurrentEncoder",
    "SolveError": "expertaug.errors:SolveError",
    "Solver": "expertaug.systems.solvers.solver:Solver",
    "System": "expertaug.systems.base:System",
    "Term": "expertaug.models.terms:Term",
    "TrainedModel": "expertaug.api.trained:TrainedModel",
    "Trajectories": "expertaug.trajectories:Trajectories",
    "WindowEncoder": "expertaug.models.encoders.window:WindowEncoder",
    "alarm": "expertaug.api.alarm",
    "alternate": "expertaug.api.inference:alternate",
    "augment": "expertaug.api.training:augment",
    "compare": "expertaug.api.compare:compare",
    "diagnostics": "expertaug.api.diagnostics",
    "evaluate": "expertaug.api.trained:evaluate",
    "explain": "expertaug.api.explain:explain",
    "finetune": "expertaug.api.training:finetune",
    "Band": "expertaug.api.posterior:Band",
    "fit_posterior": "expertaug.api.posterior:fit_posterior",
    "predictive": "expertaug.api.posterior:predictive",
    "fit": "expertaug.api.training:fit",
    "forecast": "expertaug.api.trained:forecast",
    "least_squares": "expertaug.api.inference:least_squares",
    "load": "expertaug.api.trained:load",
    "metrics": "expertaug.api.metrics",
    "own_prior": "expertaug.api.inference:own_prior",
    "plots": "expertaug.api.plots",
    "read_measurements": "expertaug.api.measurements:read_measurements",
    "simulate": "expertaug.systems.simulate:trajectories",
    "split_measurements": "expertaug.api.measurements:split_measurements",
    "validity": "expertaug.api.inference:validity",
}


def __getattr__(name: str) -> object:
    if name not in _EXPORTS:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, _, attribute = _EXPORTS[name].partition(":")
    loaded = importlib.import_module(module)
    globals()[name] = getattr(loaded, attribute) if attribute else loaded
    return globals()[name]


def __dir__() -> list[str]:
    return sorted({*globals(), *_EXPORTS, "__version__"})
