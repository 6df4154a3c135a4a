"""Why the spots of the plane frames are not the nominal mesh: the value that was mistyped."""

from dataclasses import replace

from calibration.files import list_names
from calibration.identity import Candidates, MeshError, identify
from calibration.mesh_search import MeshSearch
from hdl.protocol import MOST_BEAMS
from model.errors import UserError

__all__ = ["check_planes", "identify_or_explain"]

#: Fewer spots than this in a frame are none.
_FEW = 3
#: A corrected value must explain so large a share of the spots, and leave so much less unexplained.
_SHARE, _GAIN = 0.75, 0.5


def check_planes(planes):
    """Refuse plane frames most of which have no spots.

    Parameters
    ----------
    planes : sequence of :class:`calibration.identity.PlaneSpots`
        Spots of all plane frames.
    """
    dark = [plane.name for plane in planes if len(plane.x) < _FEW]
    if len(dark) > len(planes) / 2:
        raise UserError(
            f"No spots were found in {len(dark)} of the {len(planes)} plane frames "
            f"({list_names(dark, 6)}): check that the laser was on and that these are pattern "
            "frames, not textures, or choose other limits (--threshold, --area-min, --area-max).")


def _corrections(nominal):
    """Meshes with one value corrected, and what to say of each."""
    x, y, z = nominal.base_mm
    where = "in [projector] of capture.toml"
    yield (f"base_mm has the wrong sign {where}: the projector is on the other side, x = {-x:g}",
           replace(nominal, base_mm=(-x, y, z)))
    yield (f"toe_in_deg has the wrong sign {where}: positive is towards the camera's axis",
           replace(nominal, toe_in_deg=-nominal.toe_in_deg))
    yield (f"rotation_deg has the wrong sign {where}: positive is from x towards y",
           replace(nominal, rotation_deg=-nominal.rotation_deg))
    if nominal.rows != nominal.columns:
        yield (f"rows and columns are exchanged {where}",
               replace(nominal, rows=nominal.columns, columns=nominal.rows))
    for name in ("rows", "columns"):
        count = getattr(nominal, name)
        for other in (count - 1, count + 1, count - 2, count + 2):
            changed = replace(nominal, **{name: max(other, 1)})
            if other >= 1 and changed.beams <= MOST_BEAMS:
                yield (f"the mesh has {other} {name}, not {count}: correct {name} {where}", changed)
    for factor in (10, 0.1, 1000, 0.001):
        base = tuple(factor * part for part in nominal.base_mm)
        yield (f"base_mm {where} or z_mm in planes.csv is wrong by a factor of "
               f"{max(factor, 1 / factor):g}: both are in millimetres",
               replace(nominal, base_mm=base))


def _explain(planes, nominal, lens, scale_sigma):
    """The correction that explains the spots, in words, or None."""
    whole = sum(len(plane.x) for plane in planes)
    best, words = _GAIN * whole, None
    for text, mesh in _corrections(nominal):
        search = MeshSearch(planes, mesh, lens, scale_sigma)
        (cost, count, missing), vector, _ = Candidates(search).best()
        share = count / max(count + missing, 1)
        if cost < best and share >= _SHARE and search.within(vector):
            best, words = cost, text
    return words


def identify_or_explain(planes, nominal, lens, scale_sigma=0.0, dead=()):
    """As :func:`calibration.identity.identify`; a refusal names the mistyped value, if it is one.

    Parameters
    ----------
    planes, nominal, lens, scale_sigma, dead
        As in :func:`calibration.identity.identify`.

    Returns
    -------
    :class:`calibration.identity.Identity`
    """
    try:
        return identify(planes, nominal, lens, scale_sigma, dead)
    except MeshError as error:
        words = _explain(planes, nominal, lens, scale_sigma)
        if words is None:
            raise
        raise UserError(
            f"The spots of the plane frames are not the nominal mesh: {words}.") from error
