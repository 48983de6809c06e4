"""Kinds of encoders and interaction models, by name alone."""

from __future__ import annotations

from expertaug.registry import Part

ENCODER = Part(
    "encoder",
    {
        "recurrent": "expertaug.models.encoders.recurrent:RecurrentEncoder",
        "window": "expertaug.models.encoders.window:WindowEncoder",
        "two_step": "expertaug.models.encoders.two_step:MLPTwoStep",
        "conv_two_step": "expertaug.models.encoders.two_step_fields:ConvTwoStep",
        "conv": "expertaug.models.encoders.convolutional:ConvEncoder",
        "moments": "expertaug.models.encoders.moments:MomentEncoder",
    },
    base="torch.nn:Module",
    needed="forward",
    given=("system", "times"),
)
INTERACTION = Part(
    "interaction",
    {
        "mlp": "expertaug.models.interactions.mlp:MLPInteraction",
        "conv": "expertaug.models.interactions.convolutional:ConvInteraction",
        "polynomial": "expertaug.models.interactions.polynomial:PolynomialInteraction",
        "damping": "expertaug.models.interactions.damping:DampingInteraction",
    },
    base="torch.nn:Module",
    needed="forward",
    given=("system", "latent", "times"),
)
PARTS = {part.name: part for part in (ENCODER, INTERACTION)}
