"""Where a model was learned: the range of z_e and z_a over its training windows, and which windows lie outside.

F_a has seen the z_a of the training windows and no others; beyond them it says something, which nothing has tested.
The observed window alone does not show it: there F_a may still fit.
"""

from __future__ import annotations

import torch
from torch import Tensor

from expertaug.models.card import ModelCard, SupportRecord
from expertaug.models.posterior import Estimates
from expertaug.models.settings import MARGIN
from expertaug.systems import System

TAIL = 0.005  # share of training windows, at each end, that may be fitted wrongly


def support_of(z_e: Tensor | None, z_a: Tensor | None) -> SupportRecord:
    """What a model file says of the estimates of its training windows, z_e (S, N, P) and z_a (S, N, Q)."""
    ranges = {}
    for name, values in (("z_e", z_e), ("z_a", z_a)):
        if values is not None and values.shape[-1]:
            finite = values.detach().double().cpu().nan_to_num(0.0, 0.0, 0.0)
            ends = torch.quantile(finite, torch.tensor([TAIL, 1 - TAIL], dtype=torch.float64), dim=1)
            ranges |= {f"least_{name}": ends[0].tolist(), f"most_{name}": ends[1].tolist()}
    return SupportRecord.of(**ranges)


def outside_support(system: System, card: ModelCard, estimates: Estimates) -> Tensor | None:
    """Which windows (S, N) have a z_e or z_a outside the range of the training windows', by more than a tenth of its
    width; None of a model whose file does not say it, since it learned from no windows.

    Augmented samples are training windows too: z_e may lie anywhere in p⁺, and so where fits of windows start.
    """
    learned = card if card.base is None else card.base
    record = learned.support
    if record is None:
        return None
    refined = None if card.refinement is None else card.refinement.prior
    own = None if isinstance(refined, str) else refined
    priors = [prior for prior in (learned.augmented_prior, card.prior, own) if prior]
    names = [parameter.name for parameter in system.expert_parameters]
    beyond = None
    for values, least, most, wider in (
        (estimates.z_e, record.least_z_e, record.most_z_e, priors),
        (estimates.z_a, record.least_z_a, record.most_z_a, []),
    ):
        if values is None or least is None or most is None:
            continue
        low, high = (torch.tensor(ends, dtype=torch.float64).unsqueeze(1) for ends in (least, most))
        for prior in wider:
            ends = torch.tensor([tuple(prior[name]) for name in names], dtype=torch.float64)
            low, high = torch.minimum(low, ends[:, 0]), torch.maximum(high, ends[:, 1])
        slack = MARGIN * (high - low)
        here = values.detach().double().cpu()
        here = ~((here >= low - slack) & (here <= high + slack)).all(-1)  # what is not a number is outside
        beyond = here if beyond is None else beyond | here
    return beyond
