"""What a system calls its components: measurements are in this order, and its inputs are what the names say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from swings import NAMES, settings, trials

from expertaug.errors import InputError
from expertaug.measurements.cut import all_chunks, measure
from expertaug.measurements.names import Names


def test_states_come_in_the_order_of_the_names_whatever_that_of_the_columns(tmp_path):
    path = trials(tmp_path, count=1)
    other = Names(dict(reversed(NAMES.state.items())), NAMES.parameters)
    one, turned = (all_chunks(measure(settings(path), names)) for names in (NAMES, other))
    assert np.array_equal(one.y, turned.y[..., ::-1]) and one.u is None


@pytest.mark.parametrize(
    ("said", "change", "message"),
    [
        ({}, {"inputs": {}}, "inputs.torque: missing, the system is driven by it"),
        ({"held": True}, {"uneven": "interpolate"}, "the system's inputs hold their values between the rows"),
        ({"constant": frozenset({"torque"})}, {}, "torque changes along swings/0/2; a covariate is constant"),
    ],
)
def test_known_inputs_are_what_the_names_say_of_them(tmp_path, said, change, message):
    given = settings(
        trials(tmp_path, count=1), **{"columns": {"theta": "angle"}, "inputs": {"torque": "speed"}} | change
    )
    with pytest.raises(InputError, match=message):
        all_chunks(measure(given, replace(NAMES, inputs={"torque": ""}, **said)))
