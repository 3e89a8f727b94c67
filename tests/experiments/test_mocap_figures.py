"""Strides of both legs, laid over each other for a figure."""

import numpy as np
import pytest
from mecazen_experiments.mocap_figures import by_stride


def test_strides_are_laid_over_each_other():
    progress = np.linspace(0.3, 3.7, 200)
    phases = np.stack((progress % 1.0, (progress + 0.5) % 1.0), axis=-1)
    values = np.stack((100.0 * phases[:, 0], 100.0 * phases[:, 1]), axis=-1)
    values[5:8] = np.nan
    strides = by_stride(phases, values)
    assert strides.shape == (5, 51)
    assert strides[:, 25] == pytest.approx(50.0, abs=1.0)
