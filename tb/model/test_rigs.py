"""The rigs keep what their table promises, and nominal values are as wrong as they say."""


import numpy as np

from model.optics import rigs, scenes, spots
from model.optics.geometry import line_separation
from tb.model.truth import ALL, uv


@ALL
def test_rigs_keep_their_promises(rig):
    """Lines of all beams are apart over the whole mesh; of the dense one where both can be."""
    documented = {"endoscope": 4.85, "demonstrator": 3.05, "small": 2.65, "dense": 1.9,
                  "vga": 8.05}[rig.name]
    planes = rig.calibration_planes()
    assert len(planes) >= 8 and planes.min() < rig.range_mm[0] and planes.max() > rig.range_mm[1]
    shared, whole_mesh = line_separation(rig.camera, rig.projector, planes.min(), planes.max())
    assert (shared if rig.name == "dense" else whole_mesh) > documented
    for z in planes:
        truth, _, _ = spots.trace(rig, scenes.Plane(z))
        assert truth["visible"].all() and rig.camera.inside(uv(truth), rig.margin_px * 0.8).all()
        widest = 3.0 if rig.name == "vga" else 2.0
        assert (truth["sigma_minor_px"] > 1.0).all() and (truth["sigma_major_px"] < widest).all()
        inside = rig.range_mm[0] <= z <= rig.range_mm[1]
        assert (truth["inside"] == inside).all()


@ALL
def test_nominal_values_are_off_but_not_by_more_than_they_say(rig):
    worst = np.zeros(4)
    for seed in range(30):
        nominal = rigs.nominal(rig, np.random.default_rng(seed))
        base, wrong = np.array(rig.projector.base_mm), np.array(nominal.base_mm)
        error = np.array([
            nominal.focal_px / rig.camera.focal_px - 1,
            nominal.pitch_deg / rig.projector.pitch_deg - 1,
            np.linalg.norm(wrong - base) / np.linalg.norm(base),
            max(abs(nominal.rotation_deg - rig.projector.rotation_deg),
                abs(nominal.toe_in_deg - rig.projector.toe_in_deg))])
        worst = np.maximum(worst, np.abs(error))
    assert (worst < [0.0301, 0.0301, 0.034, 1.001]).all()
    assert (worst > [0.02, 0.02, 0.02, 0.7]).all()
    exact = rigs.nominal(rig, np.random.default_rng(0), error=0)
    assert exact.focal_px == rig.camera.focal_px and exact.base_mm == rig.projector.base_mm
