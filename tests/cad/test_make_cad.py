from dataclasses import replace

import numpy as np
import pytest

from retrue.cad.make_cad import make_cad
from retrue.cad.options import CadOptions
from retrue.cad.surfaces import PlaneSurface
from retrue.errors import DegenerateError, FileError, InputError
from retrue.files import step as step_file
from retrue.files.step import require_step, write_step
from retrue.reconstruction.cloud import Cloud

from .occ import StepFile, require_opencascade

HEIGHT, WIDTH, FOCAL = 90, 120, 200.0
NOISE = 0.05


def cloud_of(depth, noise=NOISE, seed=0):
    """Points whose depth is a function of the ray (x, y), one for each pixel; noise is that of depth."""
    v, u = np.mgrid[0:HEIGHT, 0:WIDTH]
    x, y = (u.ravel() - WIDTH / 2) / FOCAL, (v.ravel() - HEIGHT / 2) / FOCAL
    z = depth(x, y) + np.random.default_rng(seed).normal(scale=noise, size=x.size)
    points = np.column_stack([x * z, y * z, z])
    pixels = np.column_stack([u.ravel(), v.ravel()])
    return Cloud(points, np.zeros((len(z), 3), np.uint8), pixels.astype(float), "mm", pixels[:, ::-1])


def wave(x, y):
    return 500 + 8 * np.sin(18 * x) * np.cos(15 * y)


def gable(x, _y):
    """Two walls that meet at a right angle in the middle."""
    return 500 / (1 + np.abs(x))


def test_a_wavy_surface_becomes_one_spline_that_averages_the_noise():
    cloud = cloud_of(wave)
    (patch,) = make_cad(cloud).patches
    assert patch.surface.kind == "b-spline"
    assert patch.met
    assert patch.rms_error == pytest.approx(NOISE, rel=0.2)
    exact = cloud_of(wave, noise=0)
    inner = (np.abs(exact.cells - [HEIGHT / 2, WIDTH / 2]) < [HEIGHT / 2 - 3, WIDTH / 2 - 3]).all(axis=1)
    assert np.abs(patch.surface.distances(exact.points[inner])).max() < 1.5 * NOISE


def test_a_looser_tolerance_takes_fewer_poles():
    fine, coarse = (make_cad(cloud_of(wave), CadOptions(cad_tolerance=t)).patches[0] for t in (0.3, 3.0))
    assert fine.met
    assert coarse.met
    assert coarse.surface.coefficients.size < fine.surface.coefficients.size


def test_a_tolerance_finer_than_the_noise_is_not_met_and_says_so():
    (patch,) = make_cad(cloud_of(wave), CadOptions(cad_tolerance=NOISE)).patches
    assert patch.tolerance == NOISE
    assert patch.max_error > NOISE
    assert not patch.met


def test_a_gable_becomes_two_planes_at_a_right_angle():
    model = make_cad(cloud_of(gable))
    first, second = (patch.surface for patch in model.patches)
    assert isinstance(first, PlaneSurface)
    assert isinstance(second, PlaneSurface)
    assert np.degrees(np.arccos(first.normal @ second.normal)) == pytest.approx(90.0, abs=0.1)
    assert model.left_out < 0.06 * model.points


def test_points_without_noise_are_met_all_the_same():
    model = make_cad(cloud_of(gable, noise=0.0))
    assert [patch.surface.kind for patch in model.patches] == ["plane", "plane"]
    assert all(patch.met and patch.tolerance < 1e-3 for patch in model.patches)


def test_a_hole_in_a_surface_is_a_hole_in_its_face():
    cloud = cloud_of(wave)
    kept = (np.abs(cloud.cells - [45, 60]) > 8).any(axis=1)
    (patch,) = make_cad(cloud.select(kept)).patches
    ((outer, hole),) = patch.outlines
    assert len(outer) > len(hole) > 20


def test_strays_are_on_no_patch():
    cloud = cloud_of(wave)
    stray = np.arange(0, len(cloud), 501)
    points = cloud.points.copy()
    points[stray] *= 1.05
    (patch,) = make_cad(replace(cloud, points=points)).patches
    assert not np.isin(stray, patch.rows).any()
    assert patch.met


@pytest.mark.parametrize("depth", [wave, gable, lambda x, y: 500 - 40 * (x + 2 * y)])
def test_step_is_valid_and_as_near_as_it_says(tmp_path, depth):
    require_opencascade()
    cloud = cloud_of(depth)
    model = make_cad(cloud)
    write_step(tmp_path / "part.stp", model)
    step = StepFile.read(tmp_path / "part.stp")
    assert step.valid
    for patch in model.patches:
        inner = patch.rows[(np.abs(cloud.camera_px[patch.rows] - [60, 45]) < [55, 40]).all(axis=1)]
        inner = inner[np.abs(cloud.camera_px[inner, 0] - 60) > 3]  # the outline is within the points
        some = cloud.points[inner[:: len(inner) // 40]]
        assert max(step.distances(some)) <= patch.tolerance
        assert np.allclose(step.distances(some), np.abs(patch.surface.distances(some)), atol=0.05 * patch.tolerance)


def test_writing_step_says_nothing_on_stdout(tmp_path, capfd):
    require_opencascade()
    write_step(tmp_path / "part.step", make_cad(cloud_of(gable)))
    assert capfd.readouterr().out == ""
    assert [path.name for path in tmp_path.iterdir()] == ["part.step"]


def test_scattered_points_have_no_surfaces():
    with pytest.raises(InputError, match="cad: expected points of a capture with a grid"):
        make_cad(replace(cloud_of(wave), cells=None))


def test_points_far_from_each_other_have_no_surfaces():
    cloud = cloud_of(wave)
    apart = replace(cloud.select(slice(None, None, 97)), cells=2 * cloud.cells[::97])
    with pytest.raises(DegenerateError, match="give --cad-tolerance"):
        make_cad(apart)
    with pytest.raises(DegenerateError, match="no smooth region"):
        make_cad(apart, CadOptions(cad_tolerance=1.0))


def test_a_missing_opencascade_names_the_extra(monkeypatch):
    def absent(name):
        raise ImportError(name)

    monkeypatch.setattr(step_file, "import_module", absent)
    with pytest.raises(InputError, match=r"pip install '\.\[cad\]'"):
        require_step("part.step", "mm")


def test_step_needs_its_ending_and_a_known_unit():
    with pytest.raises(FileError, match=r"expected a CAD file that ends in \.step or \.stp, found 'part.iges'"):
        require_step("part.iges", "mm")
    with pytest.raises(InputError, match="whose length is not known"):
        require_step("part.step", "square")
