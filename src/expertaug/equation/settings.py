"""Typed settings of the search for what an expert lacks; no numerical library is loaded here."""

from __future__ import annotations

from typing import ClassVar

from expertaug.settings import Count, Settings, key


class EquationSettings(Settings):
    """The search for terms that an expert lacks."""

    WHERE: ClassVar[str] = "equation"

    samples: Count = key(200, "maximum number of windows of the training and of the validation set, spread evenly")
    most_terms: Count = key(8, "maximum number of terms of a formula")
    extra: list[str] = key(list, "further candidates beside the library, each as `rate: expression`")
    by_hand: list[str] = key(list, "terms that a scientist would write, which are fitted for comparison")
    components: list[str] | None = key(
        None, "in whose rates terms are sought; null = those on which F_a acts, or that are no other component"
    )
    kinematics: bool = key(False, "whether terms are sought in rates that are another component, as θ' of a pendulum")
    by_parameters: bool = key(False, "whether candidates are divided by expert parameters too, as forces by an inertia")
