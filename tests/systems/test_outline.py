"""What tables need to know of a system, without loading torch for the package's own: the same as its class says."""

from __future__ import annotations

import subprocess
import sys

import pytest

from expertaug import systems
from expertaug.errors import InputError
from expertaug.systems.settings import SYSTEMS

CHOICES = [
    {"name": "pendulum", "friction": "estimated", "observed": "angle"},
    {"name": "pendulum", "start_radius": [0.5, 1.0]},
    {"name": "driven_pendulum", "torque": "hidden"},
    {"name": "bouncing_ball", "rest_m_s": 0.1, "observed": "height"},
    {"name": "rlc", "source": "measured", "equations": "code", "source_rad_s": 3},
    {"name": "double_pendulum", "expert": "point_mass"},
    {"name": "expertaug.systems.pendulum"},
    *({"name": name} for name, kind in SYSTEMS.items() if kind.TABLES is not None),
]
REFUSED = [
    {"nam": 1},
    {"name": "pendulm"},
    {"name": "wave"},
    {"name": "double_pendulum"},
    {"name": "pendulum", "colour": 1},
    {"name": "pendulum", "observed": "x"},
    {"name": "pendulum", "start_radius": [1.0, 9.0]},
]


@pytest.mark.parametrize("settings", CHOICES, ids=lambda settings: "-".join(map(str, settings.values())))
def test_an_outline_is_what_the_class_says(settings):
    outline, system = systems.outline(settings), systems.load(settings)
    assert outline.names == systems.names(system)
    assert list(outline.constants) == systems.constants(system)
    lowest = {p.name: (0.3 if p.positive else -3.0) * p.scale for p in system.expert_parameters}
    assert outline.priors == {p.name: (lowest[p.name], 3.0 * p.scale) for p in system.expert_parameters}


@pytest.mark.parametrize("settings", REFUSED, ids=lambda settings: "-".join(map(str, settings.values())))
def test_what_a_class_refuses_is_refused_in_its_words(settings):
    with pytest.raises(InputError) as refused:
        systems.outline(settings)
    with pytest.raises(InputError) as by_class:
        systems.names(systems.load(settings))
    assert str(refused.value) == str(by_class.value)


def test_names_for_tables_need_no_torch():
    """It takes more memory than a table of a million rows does, and scipy.stats as long as reading a quarter of it."""
    code = """if True:
        import sys
        from expertaug import systems
        from expertaug.measurements import cut
        systems.outline({"name": "pendulum"})
        print({"torch", "scipy.stats"} & set(sys.modules))
    """
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"
