"""What the chip is, what state it is in, and why it refuses a command."""

from hdl.protocol import (
    IDENTITY_FIELDS,
    MOST_BEAMS,
    PRESET_NAMES,
    PROTOCOL_VERSION,
    SENSOR_PIXELS,
    STATUS_FIELDS,
    TABLE_VERSION,
    Mode,
    Reason,
    registers,
)
from model.errors import UserError
from scripts.host.messages import fields_of

__all__ = ["ADJUSTABLE", "REGISTERS", "SENTENCES", "RefusedError", "State", "check_chip",
           "check_value", "other_length", "parse_identity", "parse_status"]

#: Registers by their names.
REGISTERS = {register.name: register for register in registers()}

_TIMES = {"pattern_us": "points, exposure \u00b5s", "texture_us": "picture, exposure \u00b5s",
          "period_us": "from pair to pair, \u00b5s"}
_SENT = {"pattern_every": "points of one pattern in", "points_max": "points, at most (0: all)",
         "texture_enable": "picture sent (1 or 0)"}
#: Registers to be adjusted while frames are looked at, by presets, and what they are in words.
ADJUSTABLE = {
    "capsule": {**_TIMES, "lit_gain": "level of spots (sixteenths)",
                "core_gain": "level of cores (sixteenths)",
                "dent_gain": "depth of dents (sixteenths)", **_SENT},
    "paper": {**_TIMES, "threshold_alpha": "threshold (sixteenths)",
              "threshold_fixed": "threshold fixed (1 or 0)",
              "threshold_level": "the fixed threshold", **_SENT}}

#: What each reason of a refusal means, to follow "The chip refused ...: ".
SENTENCES = {
    Reason.UNKNOWN_COMMAND: "it does not know this command, so it is of another version.",
    Reason.WRONG_LENGTH: "the command has a length that it does not take, so it is of another "
                         "version.",
    Reason.UNKNOWN_REGISTER: "it does not have this register.",
    Reason.OUT_OF_RANGE: "a value or an address is outside of its limits.",
    Reason.OTHER_SENSOR: "the tables are for another sensor, another number of beams or another "
                         "version of the tables: calibrate this rig.",
    Reason.UNKNOWN_TABLE: "it does not have this table.",
    Reason.BUSY: "a set of tables still waits for its frame, or spots of a frame hold the tables; "
                 "try again, with the chip stopped if need be (`cyclope load PORT --stop`).",
    Reason.NO_BEGIN: "it forgot that a set of tables was begun (was it reset?): load again.",
    Reason.DAMAGED_TABLE: "its memory does not hold what was sent: load again, and if it stays "
                          "so, the chip is at fault.",
    Reason.NOT_STOPPED: "it has to be stopped first (`cyclope load PORT --stop`).",
    Reason.DAMAGED_PACKET: "commands arrive damaged: is the line too long or too noisy?",
}

_IDENTITY_OCTETS = sum(field.bits for field in IDENTITY_FIELDS) // 8
_STATUS_OCTETS = sum(field.bits for field in STATUS_FIELDS) // 8


class RefusedError(UserError):
    """The chip refused a command; ``reason`` says why.

    ``repeated`` if the command was sent before, so that the chip may have carried it out.
    """

    def __init__(self, what, reason, repeated=False):
        try:
            sentence = SENTENCES[Reason(reason)]
        except (ValueError, KeyError):
            sentence = f"reason {reason}, which this program does not know."
        super().__init__(f"The chip refused {what}: {sentence}")
        self.reason, self.repeated = reason, repeated


class State:
    """The octet ``state`` of STATUS, bit by bit."""

    def __init__(self, octet):
        self.tables_valid, self.armed, self.capture, self.committing = (
            bool(octet >> bit & 1) for bit in range(4))
        self.bank = octet >> 4 & 1
        self.mode = Mode(octet >> 5 & 3)
        self.silent = bool(octet >> 7)


def check_chip(identity, calibration):
    """Refuse a chip that the calibration is not for."""
    size = identity["width"], identity["height"]
    if size != (calibration.width, calibration.height):
        raise UserError(
            f"The calibration is for a sensor of {calibration.width} x {calibration.height} "
            f"pixels, the chip has one of {size[0]} x {size[1]}: calibrate this rig.")
    beams = len(calibration.settings.line)
    if identity["beams"] != beams:
        raise UserError(f"The calibration has {beams} beams, the chip is made for "
                        f"{identity['beams']}: calibrate this rig.")
    corrects = identity["preset"] == PRESET_NAMES.index("paper")
    if calibration.settings.remap and not corrects:
        raise UserError("The calibration is for a chip that corrects whole images (`cyclope "
                        "calibrate --preset paper`), which this one does not: calibrate without.")
    if corrects and not calibration.settings.remap:
        raise UserError("The chip corrects whole images, and the calibration has no table for "
                        "that: calibrate with `cyclope calibrate --preset paper`.")


def check_value(name, value):
    """Refuse a register that there is not, or a value that it cannot have.

    Parameters
    ----------
    name : :class:`str`
        Of the register.
    value : :class:`int`
        What is to be written.
    """
    if name not in REGISTERS:
        raise UserError(f"There is no register {name[:40]!r}; there are: {', '.join(REGISTERS)}.")
    register = REGISTERS[name]
    half = 1 << register.bits - 1
    low, high = (-half, half - 1) if register.signed else (register.low, 2 * half - 1)
    high = high if register.high is None else register.high
    if not low <= value <= high:
        raise UserError(f"{name} must be {low} to {high}, not {str(value)[:40]}.")


def parse_identity(data):
    """IDENTITY_FIELDS by their names, from the reply to IDENTIFY.

    Raises
    ------
    UserError
        If the chip is of another version than this program.
    """
    version = data[0] if data else 0
    if version != PROTOCOL_VERSION:
        raise UserError(f"The chip speaks version {version} of the protocol, this program version "
                        f"{PROTOCOL_VERSION}: use the program of the chip's version.")
    if len(data) != _IDENTITY_OCTETS:
        raise other_length("IDENTIFY", data, _IDENTITY_OCTETS)
    values = fields_of(data, IDENTITY_FIELDS)
    if values["tables"] != TABLE_VERSION:
        raise UserError(f"The chip takes tables of version {values['tables']}, this program has "
                        f"those of version {TABLE_VERSION}: use the program of the chip's version.")
    width, height, beams = (values[name] for name in ("width", "height", "beams"))
    low, high = SENSOR_PIXELS
    if not (low <= width <= high and low <= height <= high and 1 <= beams <= MOST_BEAMS):
        raise UserError(f"The chip says it has {width} x {height} pixels and {beams} beams, and "
                        f"there are {low} to {high} pixels either way and 1 to {MOST_BEAMS} beams: "
                        "use the program of the chip's version.")
    return values


def parse_status(data):
    """STATUS_FIELDS by their names, from the reply to STATUS; ``state`` is a :class:`State`.

    Raises
    ------
    UserError
        If the reply has another length.
    """
    if len(data) != _STATUS_OCTETS:
        raise other_length("STATUS", data, _STATUS_OCTETS)
    values = fields_of(data, STATUS_FIELDS)
    return {**values, "state": State(values["state"])}


def other_length(what, data, wanted):
    """The error for a reply of another length than the command has."""
    return UserError(f"The chip's reply to {what} has {len(data)} octets, not {wanted}: use the "
                     "program of the chip's version.")
