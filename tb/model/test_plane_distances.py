"""Wrong distances of the planes: a constant error is corrected, a mistyped one is named."""

from dataclasses import replace

import numpy as np
import pytest

from calibration.identity import identify
from calibration.lines import Observations, fit_lines
from calibration.plane_check import check_plane_positions
from calibration.plane_offset import corrected, estimate_offset
from model.errors import UserError
from model.optics.geometry import beam_lines
from model.optics.rigs import RIGS
from tb.model.rig_spots import observe


def shifted(planes, offset):
    """The planes as a planes.csv with a constant error has them."""
    return [replace(plane, z_mm=plane.z_mm + offset) for plane in planes]


@pytest.mark.parametrize("seed", [41, 42])
@pytest.mark.parametrize("offset", [1.0, -2.0])
def test_a_constant_error_is_found_and_corrected(offset, seed):
    rig = RIGS["endoscope"]
    planes, truth, nominal, lens = observe(rig, seed, noise=0.02, planes=12)
    planes = shifted(planes, offset)
    identity = identify(planes, nominal, lens)
    assert all(np.mean(found == true) > 0.99
               for found, true in zip(identity.beams, truth, strict=True))
    # The projector is that of the true distances.
    assert np.abs(np.array(identity.projector.base_mm) - rig.projector.base_mm).max() < 0.05
    data = Observations.of(planes, identity, lens)
    found = estimate_offset(data)
    assert abs(found.mm + offset) < min(0.1, 4 * found.sigma_mm)
    assert found.correction_mm == found.mm and found.sigma_mm < 0.025
    lines = fit_lines(corrected(data, found.correction_mm), lens)
    exact = beam_lines(rig.camera, rig.projector)
    for z in (40, 60, 110):
        depth = 1 / (lines.alpha * exact.column_at(z) + lines.beta)
        assert np.mean(np.abs(depth / z - 1)) < 0.001


def test_true_distances_are_not_corrected():
    sigma = []
    for seed in range(43, 46):
        planes, _, nominal, lens = observe(RIGS["endoscope"], seed, noise=0.02, planes=12)
        found = estimate_offset(Observations.of(planes, identify(planes, nominal, lens), lens))
        assert found.correction_mm == 0
        sigma.append(found.mm / found.sigma_mm)
    assert 0.05 < np.std(sigma) < 2


def test_a_wrong_scale_is_not_visible():
    planes, _, nominal, lens = observe(RIGS["endoscope"], 47, noise=0.02, planes=12)
    planes = [replace(plane, z_mm=1.01 * plane.z_mm) for plane in planes]
    found = estimate_offset(Observations.of(planes, identify(planes, nominal, lens), lens))
    assert found.correction_mm == 0


def test_uneven_distances_make_the_offset_uncertain():
    """Errors of single planes are not taken for a constant one."""
    planes, _, nominal, lens = observe(RIGS["endoscope"], 48, noise=0.02, planes=12)
    rng = np.random.default_rng(2)
    planes = [replace(plane, z_mm=plane.z_mm * (1 + 0.003 * rng.normal())) for plane in planes]
    found = estimate_offset(Observations.of(planes, identify(planes, nominal, lens), lens))
    assert found.sigma_mm > 0.08 and abs(found.mm) < 4 * found.sigma_mm


@pytest.mark.parametrize("number, factor", [(0, 1.01), (5, 0.97), (9, 1.2), (5, 10), (0, 0.2)])
def test_a_mistyped_distance_is_named(number, factor):
    planes, _, nominal, lens = observe(RIGS["endoscope"], 49, noise=0.02)
    planes = shifted(planes, 0.5)
    true = planes[number].z_mm
    planes[number] = replace(planes[number], z_mm=true * factor, name="wrong.png")
    with pytest.raises(UserError, match=r"planes.csv gives .* mm for wrong.png, but its spots are "
                                        r"those of a plane at about") as refusal:
        check_plane_positions(planes, identify(planes, nominal, lens), lens)
    said = float(str(refusal.value).split("at about ")[1].split()[0])
    assert abs(said / true - 1) < 0.02


@pytest.mark.parametrize("count", [4, 6])
def test_uneven_distances_are_not_called_mistyped(count):
    for seed in range(2):
        planes, _, nominal, lens = observe(RIGS["endoscope"], 50 + seed, planes=count)
        rng = np.random.default_rng(seed)
        planes = [replace(plane, z_mm=plane.z_mm * (1 + 0.003 * rng.normal())) for plane in planes]
        check_plane_positions(planes, identify(planes, nominal, lens), lens)


def test_a_frame_with_few_spots_is_not_called_mistyped():
    planes, _, nominal, lens = observe(RIGS["endoscope"], 54)
    few = {name: getattr(planes[3], name)[:12] for name in ("u", "v", "x", "y", "area")}
    planes[3] = replace(planes[3], **few)
    check_plane_positions(planes, identify(planes, nominal, lens), lens)
