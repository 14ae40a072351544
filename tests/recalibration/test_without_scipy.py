"""What was SciPy's is said in a few lines, as it says it; its import takes longer than a recalibration."""

import subprocess
import sys

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.special import chdtrc, chdtri

from retrue.geometry.transform import vector_from_rotation
from retrue.recalibration.chance import deviations_limit, deviations_of_mixture


@pytest.mark.parametrize("share", [1 - 1e-6, 0.5, 0.1, 1e-3, 1e-9, 1e-50, 1e-290])
def test_limit_is_the_quantile_of_chi_with_five_degrees_of_freedom(share: float) -> None:
    assert deviations_limit(share) == pytest.approx(np.sqrt(chdtri(5, share)), rel=1e-12)


@pytest.mark.parametrize("scale", [0.0, 0.1, 1.0, 3.0, 10.0, 100.0])
def test_a_mixture_is_exceeded_as_seldom_as_its_parts_together(scale: float) -> None:
    weights, deviations = np.array([0.7, 0.2, 0.1]), scale * np.array([2.0, 1.5, 1.0])
    found = deviations_of_mixture(weights, deviations)
    assert deviations.min() <= found <= deviations.max()
    if scale < 30:
        assert chdtrc(5, found**2) == pytest.approx(weights @ chdtrc(5, deviations**2), rel=1e-6)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-6, 0.1, 2.0, np.pi - 1e-7, np.pi])
def test_rotation_vectors_are_those_of_scipy(angle: float) -> None:
    for axis in np.random.default_rng(0).normal(size=(20, 3)):
        R = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).as_matrix()
        found, expected = vector_from_rotation(R), Rotation.from_matrix(R).as_rotvec()
        if angle == np.pi:  # either sign is right
            expected *= np.sign(found @ expected)
        np.testing.assert_allclose(found, expected, atol=1e-14)


def test_a_recalibration_loads_no_scipy() -> None:
    script = (
        "import sys, numpy as np; from retrue import recalibrate; from retrue.experiments.scenes import Setup\n"
        "rng = np.random.default_rng(0)\n"
        "scene = Setup('wall', (3, -12, 1), (0.22, -0.03, 0.04), (0.25, 0.1, 1.0), 0.9).scene(300, rng)\n"
        "recalibrate(scene.rig, [scene.observed(0.3, 0.1, rng)])\n"
        "print('scipy' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
