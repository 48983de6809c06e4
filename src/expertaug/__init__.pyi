"""Types of what `expertaug` exports; at run time each name is imported when it is first used."""

from expertaug.api import alarm as alarm
from expertaug.api import diagnostics as diagnostics
from expertaug.api import metrics as metrics
from expertaug.api import plots as plots
from expertaug.api.compare import Comparison as Comparison
from expertaug.api.compare import compare as compare
from expertaug.api.explain import Equation as Equation
from expertaug.api.explain import explain as explain
from expertaug.api.forecasts import Forecast as Forecast
from expertaug.api.inference import alternate as alternate
from expertaug.api.inference import least_squares as least_squares
from expertaug.api.inference import own_prior as own_prior
from expertaug.api.inference import validity as validity
from expertaug.api.measurements import read_measurements as read_measurements
from expertaug.api.measurements import split_measurements as split_measurements
from expertaug.api.posterior import Band as Band
from expertaug.api.posterior import fit_posterior as fit_posterior
from expertaug.api.posterior import predictive as predictive
from expertaug.api.trained import TrainedModel as TrainedModel
from expertaug.api.trained import evaluate as evaluate
from expertaug.api.trained import forecast as forecast
from expertaug.api.trained import load as load
from expertaug.api.training import AugmentedSets as AugmentedSets
from expertaug.api.training import augment as augment
from expertaug.api.training import finetune as finetune
from expertaug.api.training import fit as fit
from expertaug.errors import InputError as InputError
from expertaug.errors import SolveError as SolveError
from expertaug.learning.hvae import HybridVAE as HybridVAE
from expertaug.learning.objectives import Aphynity as Aphynity
from expertaug.learning.objectives import Objective as Objective
from expertaug.models.encoders.fields import ConvEncoder as ConvEncoder
from expertaug.models.encoders.fields import MomentEncoder as MomentEncoder
from expertaug.models.encoders.recurrent import RecurrentEncoder as RecurrentEncoder
from expertaug.models.encoders.two_step import ConvTwoStep as ConvTwoStep
from expertaug.models.encoders.two_step import MLPTwoStep as MLPTwoStep
from expertaug.models.encoders.window import WindowEncoder as WindowEncoder
from expertaug.models.hybrid import HybridModel as HybridModel
from expertaug.models.interactions.convolutional import ConvInteraction as ConvInteraction
from expertaug.models.interactions.damping import DampingInteraction as DampingInteraction
from expertaug.models.interactions.drive import DriveInteraction as DriveInteraction
from expertaug.models.interactions.equation import EquationInteraction as EquationInteraction
from expertaug.models.interactions.mlp import MLPInteraction as MLPInteraction
from expertaug.models.interactions.polynomial import PolynomialInteraction as PolynomialInteraction
from expertaug.models.terms import Term as Term
from expertaug.systems.advection_diffusion import AdvectionDiffusion as AdvectionDiffusion
from expertaug.systems.base import Parameter as Parameter
from expertaug.systems.base import System as System
from expertaug.systems.bouncing_ball import BouncingBall as BouncingBall
from expertaug.systems.double_pendulum import DoublePendulum as DoublePendulum
from expertaug.systems.driven_pendulum import DrivenPendulum as DrivenPendulum
from expertaug.systems.lorenz import Lorenz as Lorenz
from expertaug.systems.lotka_volterra import LotkaVolterra as LotkaVolterra
from expertaug.systems.pendulum import DampedPendulum as DampedPendulum
from expertaug.systems.reaction_diffusion import ReactionDiffusion as ReactionDiffusion
from expertaug.systems.rlc import RLC as RLC
from expertaug.systems.simulate import trajectories as simulate
from expertaug.systems.solvers.linear_propagator import DiagonalPropagator as DiagonalPropagator
from expertaug.systems.solvers.solver import Solver as Solver
from expertaug.systems.wave import DampedWave as DampedWave
from expertaug.trajectories import Trajectories as Trajectories

__all__ = [
    "RLC",
    "AdvectionDiffusion",
    "Aphynity",
    "AugmentedSets",
    "Band",
    "BouncingBall",
    "Comparison",
    "ConvEncoder",
    "ConvInteraction",
    "ConvTwoStep",
    "DampedPendulum",
    "DampedWave",
    "DampingInteraction",
    "DiagonalPropagator",
    "DoublePendulum",
    "DriveInteraction",
    "DrivenPendulum",
    "Equation",
    "EquationInteraction",
    "Forecast",
    "HybridModel",
    "HybridVAE",
    "InputError",
    "Lorenz",
    "LotkaVolterra",
    "MLPInteraction",
    "MLPTwoStep",
    "MomentEncoder",
    "Objective",
    "Parameter",
    "PolynomialInteraction",
    "ReactionDiffusion",
    "RecurrentEncoder",
    "SolveError",
    "Solver",
    "System",
    "Term",
    "TrainedModel",
    "Trajectories",
    "WindowEncoder",
    "__version__",
    "alarm",
    "alternate",
    "augment",
    "compare",
    "diagnostics",
    "evaluate",
    "explain",
    "finetune",
    "fit",
    "fit_posterior",
    "forecast",
    "least_squares",
    "load",
    "metrics",
    "own_prior",
    "plots",
    "predictive",
    "read_measurements",
    "simulate",
    "split_measurements",
    "validity",
]

__version__: str
