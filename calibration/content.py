"""The content of a calibration file: every value of its type and within its limits."""

from dataclasses import fields, replace

from calibration.checked import InvalidError, Section
from calibration.image import LARGEST
from calibration.lens import Lens
from calibration.projector import Projector
from calibration.radial import MODELS
from calibration.remap import remap_table
from hdl.protocol import MEAN_WINDOW_PIXELS, MOST_BEAMS, TABLES, registers
from model.bayer import BAYER
from model.preprocessing.remap import pack_remap
from model.settings import EROSION_MODES, Settings

__all__ = ["checked_content"]

#: Lengths in mm or pixels, and anything else that is a plain number.
_MOST_LENGTH, _MOST_NUMBER = 1e6, 1e9
#: Characters of a remark.
_MOST_TEXT = 400


def _names(kind):
    return [each.name for each in fields(kind)]


def _sensor(content):
    """Its section, and the pattern of its colour filters, which a file may lack."""
    names = ("width", "height")
    if isinstance(content, dict) and "bayer" in content:
        section = Section("sensor", content, (*names, "bayer"))
        return section, section.choice("bayer", BAYER)
    return Section("sensor", content, names), None


def _lens(sensor, content):
    width, height = sensor.integer("width", 8, LARGEST), sensor.integer("height", 8, LARGEST)
    section = Section("lens", content, _names(Lens)[2:])
    usable = section.value("usable_px")
    lens = Lens(width, height, section.number("focal", 1, _MOST_LENGTH),
                section.number("principal_u", 0, width), section.number("principal_v", 0, height),
                *(section.number(name, -1000, 1000) for name in ("k1", "k2", "p1", "p2", "k3")),
                model=section.choice("model", MODELS),
                usable_px=None if usable is None else section.number("usable_px", 1, _MOST_LENGTH))
    if lens.folds():
        raise InvalidError("its lens folds back inside the image")
    return lens


def _projector(content):
    section = Section("projector", content, _names(Projector))
    projector = Projector(
        rows=section.integer("rows", 1, MOST_BEAMS),
        columns=section.integer("columns", 1, MOST_BEAMS),
        base_mm=section.numbers("base_mm", 3, -_MOST_LENGTH, _MOST_LENGTH),
        **{name: section.number(name, -180, 180)
           for name in ("pitch_deg", "rotation_deg", "toe_in_deg", "tilt_deg")})
    if projector.beams > MOST_BEAMS:
        raise InvalidError(f"its projector has more than {MOST_BEAMS} beams")
    return projector


def _beam(number, content, names):
    """Values of a beam, or None for one that was left out."""
    if content is None:
        return None
    section = Section(f"beam {number}", content, names)
    values = {name: section.number(name, -_MOST_NUMBER, _MOST_NUMBER) for name in names
              if name not in ("separation", "planes")}
    values["separation"] = section.value("separation")
    if values["separation"] is not None:
        section.number("separation", 0, _MOST_NUMBER)
    return {**values, "planes": section.integer("planes", 0, 1_000_000)}


def _remarks(content, beams):
    """Texts by the numbers of beams."""
    section = Section("remarks", content, tuple(content) if isinstance(content, dict) else ())
    numbers = [str(number) for number in range(beams)]
    return {int(key): section.text(key, _MOST_TEXT) for key in content
            if key in numbers or section.refuse(key, "of a beam of the mesh")}


def _settings(content, beams, lens):
    section = Section("settings", content, _names(Settings))
    limits = {}
    for register in registers():
        half = 1 << register.bits - 1
        limits[register.name] = (-half, half - 1) if register.signed else (
            register.low, 2 * half - 1)
    words = {table.name: table for table in TABLES}
    level = section.value("level_fixed")
    mean_window = section.integer("mean_window", *MEAN_WINDOW_PIXELS)
    if mean_window % 2 == 0:
        section.refuse("mean_window", "an odd number of pixels")
    settings = Settings(
        mean_window=mean_window,
        level_fixed=None if level is None else section.integer("level_fixed", 1, 255),
        erosion=section.choice("erosion", EROSION_MODES),
        weighted=section.flag("weighted"), report_rejected=section.flag("report_rejected"),
        **{name: section.integer(name, *limits[name]) for name in (
            "fixed_noise", "lit_gain", "core_gain", "dent_gain", "threshold_alpha", "area_min",
            "area_max", "saturation", "principal_u", "principal_v", "tangential_1",
            "tangential_2")},
        **{name: section.words(name, words[name].words, words[name].bits)
           for name in ("radial", "reciprocal")},
        line=section.words("line", beams, 36), window=section.words("window", beams, 36),
        depth=section.words("depth", 2 * beams, words["depth"].bits))
    # The table of the whole image follows from the lens: the file only says that there is one.
    if not section.flag("remap"):
        return settings
    table = remap_table(lens)
    try:
        pack_remap(table)
    except ValueError as error:
        raise InvalidError("its lens distorts too much for a table of the whole image") from error
    return replace(settings, remap=table)


def checked_content(content, beam_names):
    """What a :class:`calibration.file.Calibration` is made of, every value checked.

    Raises :class:`calibration.checked.InvalidError` if anything is missing, unknown, of another
    type or out of its limits.

    Parameters
    ----------
    content : :class:`dict`
        The JSON object of the file.
    beam_names : list of :class:`str`
        Keys of a beam.

    Returns
    -------
    :class:`dict`
        By the fields' names; ``beams`` is a list of dictionaries.
    """
    section = Section("the file", content, (
        "format", "version", "sensor", "units", "lens", "projector", "depth_range",
        "inverse_z_unit", "budget", "remarks", "beams", "settings", "crc32"))
    sensor, bayer = _sensor(section.value("sensor"))
    lens = _lens(sensor, section.value("lens"))
    projector = _projector(section.value("projector"))
    z_min, z_max = section.numbers("depth_range", 2, 0, _MOST_LENGTH)
    if not 0 < z_min < z_max:
        section.refuse("depth_range", "two distances, the nearer one first")
    beams = section.value("beams")
    if not isinstance(beams, list) or len(beams) != projector.beams:
        section.refuse("beams", f"a list of {projector.beams} beams")
    beams = [_beam(number, beam, beam_names) for number, beam in enumerate(beams)]
    if not any(beams):
        section.refuse("beams", "a list with at least one beam")
    budget = section.value("budget")
    return {
        "lens": lens, "bayer": bayer, "projector": projector,
        "beams": beams, "remarks": _remarks(section.value("remarks"), len(beams)),
        "settings": _settings(section.value("settings"), projector.beams, lens),
        "inverse_z_unit": section.number("inverse_z_unit", 1e-15, 1),
        "z_min": z_min, "z_max": z_max,
        "budget": Section("budget", budget, tuple(budget) if isinstance(budget, dict) else ()
                          ).figures()}
