"""Settings of models: what a class gets of them, and what is refused in one line."""

from __future__ import annotations

import inspect

import pytest

from expertaug.errors import InputError
from expertaug.models.settings import DampingSettings, PartsSettings, configure_by


def test_a_class_that_settings_configure_has_them_in_its_signature_and_in_its_docstring():
    @configure_by(DampingSettings)
    class Own:
        """Arguments:"""

        def __init__(self, system, **options):
            self.own = DampingSettings.of(**options)

    assert list(inspect.signature(Own).parameters) == ["system", "expert_parameters", "components"]
    assert "components: components that are damped" in Own.__doc__


@pytest.mark.parametrize(
    ("model", "says"),
    [
        ({"encoder": {"kind": "windw", "windows": {}}}, "kind: found 'windw'; did you mean 'window'"),
        ({"encoder": {"kind": "conv", "channels": [4], "strides": [1, 2]}}, r"strides: found \[1, 2\]; give 1 of them"),
        ({"encoder": {"kind": "recurrent", "hiden": 4}}, "hiden: unknown key; did you mean 'hidden'"),
        ({"interaction": {"kind": "mlp", "harmonics": 2}}, "harmonics: found 2; set time: true"),
        ({"interaction": {"kind": "conv", "kernels": [2, 3, 3]}}, "give 3 odd sizes"),
        ({"interaction": {"kind": "equation", "terms": ["a: b"], "coefficients": [1.0, 2.0]}}, "found 2; give 1"),
    ],
)
def test_parts_that_cannot_be_are_refused_in_a_line(model, says):
    with pytest.raises(InputError, match=says) as caught:
        PartsSettings.of(**model)
    assert "\n" not in str(caught.value)


def test_a_class_from_elsewhere_knows_its_own_arguments():
    assert PartsSettings.of(encoder={"kind": "own.module:Encoder", "depth": 3}).encoder["depth"] == 3
