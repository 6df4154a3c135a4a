"""The one source of registers, tables, commands and packets.

``hdl/link`` is built from these tables, the reader's side uses the same names and numbers, and
the tables of ``hdl/link/README.md`` are written from them by
``python -m scripts.rtl.readme_tables``.

All numbers of more than one octet go low octet first, and bits low bit first.
"""

from dataclasses import dataclass
from enum import IntEnum

__all__ = [
    "PRESET_NAMES", "PROTOCOL_VERSION", "TABLE_VERSION", "WIRE_LIMIT", "GAP_CHARACTERS",
    "CONTENT_LIMIT", "COMPACT", "PacketKind", "Flag", "Command", "Reason", "Mode", "Register",
    "Field", "Table", "TABLES", "REMAP", "TRAILER_FIELDS", "TEXTURE_FIELDS", "IDENTITY_FIELDS",
    "STATUS_FIELDS", "GUARD_CAUSES", "GUARD_LIMITS_US", "DISPLAY_FAULTS", "SENSOR_PIXELS",
    "MEAN_WINDOW_PIXELS", "MOST_BEAMS", "COORDINATE_BITS", "SMALL_SENSOR", "fraction_bits",
    "registers", "tables",
]

#: The two designs, in the order of their codes in the reply to IDENTIFY.
PRESET_NAMES = ("capsule", "paper")
#: Least and largest width and height of a sensor.
SENSOR_PIXELS = (16, 1024)
#: A sensor with no side longer than this has one fraction bit more; preset ``paper`` takes
#: no other.
SMALL_SENSOR = 512
#: Bits of a coordinate, unsigned in the image, signed about its centre once undistorted.
COORDINATE_BITS = 18
#: Least and largest side of the window of the local mean; it is odd.
MEAN_WINDOW_PIXELS = (5, 31)
#: Beams of the largest mesh.
MOST_BEAMS = 512
#: Version of packets and commands.
PROTOCOL_VERSION = 7
#: Version of the formats of the tables; the calibration file's own number follows it.
TABLE_VERSION = 1
#: Octets of a packet on the wire, both delimiters included: the payload of one 802.15.4 frame.
WIRE_LIMIT = 100
#: Character times without an octet between two packets, at the least.
GAP_CHARACTERS = 3
#: Octets of a packet before COBS (one more) and delimiters (two more), the check included.
CONTENT_LIMIT = WIRE_LIMIT - 3


def fraction_bits(width, height):
    """Bits behind the binary point of a coordinate in pixels.

    All arithmetic on coordinates is that of integers in LSBs, and the same for both.
    """
    return 9 if max(width, height) <= SMALL_SENSOR else 8


@dataclass(frozen=True)
class Field:
    """A field of a packet or of a table's word: name, bits, meaning.

    Fields of packets have whole octets, but for those that share some.
    """

    name: str
    bits: int
    meaning: str


class COMPACT:
    """The compact form of an ok point, bits from the lowest: `long`, v, u, area, two flags.

    Short (``long`` = 0): v as ``v - v_before + V_OFFSET`` in V_BITS, u in 18, area in AREA_BITS.
    Long (``long`` = 1): v in 18, u in 18, the area's code in 9, ``saturated``, ``border``.
    ``v_before`` is the v of the point before in the same packet, 0 for the first. A point is short
    if its values fit and it has no flag. Points follow each other without padding; zeros fill the
    last octet. The area's code is the area below 256 pixels, 128 + area // 2 below 512, and 256 +
    area // 4 from there on.
    """

    V_BITS = 12
    V_OFFSET = 512  # LSBs
    AREA_BITS = 6
    SHORT_BITS = 1 + V_BITS + 18 + AREA_BITS
    LONG_BITS = 1 + 18 + 18 + 9 + 2


class PacketKind(IntEnum):
    """First octet of a packet from the chip. The second is its sequence number, modulo 256."""

    POINTS = 0x50  # number (low octet), compact points
    POINTS_LAST = 0x51  # number (low octet), compact points, trailer
    RECORDS = 0x52  # number (low octet), records of 10 octets
    RECORDS_LAST = 0x53  # number (low octet), records of 10 octets, trailer
    UNMATCHED = 0x54  # number (low octet), records of 10 octets: spots that are not ok
    TEXTURE = 0x58  # words of 4 octets: a head, and packed pixels, see Texture
    TEXTURE_FRAME = 0x59  # number (low octet), TEXTURE_FIELDS
    REPLY = 0x5A  # tag, command, reason, data


class Flag(IntEnum):
    """Bits of the octet ``flags``."""

    WIDE = 0  # the counts have 16 bits each
    LEARNING = 1  # no level was known yet, so no points
    BROKEN = 2  # the frame lost synchronism
    LASER = 3  # the laser was on during the exposure
    CAPTURE = 4  # taken in calibration capture
    TRIPPED = 5  # the laser guard has tripped, see STATUS
    TABLES_VALID = 6  # a set of tables was committed and checked
    TEXTURE = 7  # sent as an image, not measured


#: Trailer of a pattern frame's last packet. ``flags`` is the packet's last octet before the check;
#: counts have 16 bits if its WIDE bit is set.
TRAILER_FIELDS = (
    Field("number", 16, "frame number; pattern and texture frames count together"),
    Field("level", 12, "level from which on pixels were lit, unsigned Q8.4: above the local mean, "
                       "or in the preset `paper` above 0"),
    Field("every", 4, "the register `pattern_every`: one pattern frame in so many is measured"),
    Field("grey_noise", 16, "noise that the level is a multiple of, in eighths of a grey value; 0 "
                            "in the preset `paper`"),
    Field("saturated", 24, "pixels of grey value `saturation` or more; 0 in the preset `paper`"),
    Field("skipped", 8, "frames skipped before this one because a buffer was full, at most 255"),
    Field("exposure_us", 16, "integration time, microseconds"),
    Field("timestamp_us", 24, "start of the integration, microseconds, modulo 2^24"),
    Field("check", 16, "CRC-16/IBM-SDLC over beam (9 bits) and 1/z (18 bits) of every ok point, in "
                       "their order, low bits first, without padding"),
    Field("spots", 8, "connected components; in preset `capsule` those with a core"),
    Field("ok", 8, "points with a beam and a depth"),
    Field("noise", 8, "spots on no line"),
    Field("ambiguous", 8, "spots on several lines"),
    Field("rejected", 8, "outside the limits of area, window, coordinates or depth; in "
                         "preset `paper` also without a core"),
    Field("dropped", 8, "spots lost because a queue was full"),
    Field("unlisted", 8, "noise, ambiguous and rejected spots that are in no packet"),
    Field("flags", 8, "see Flag"),
)
#: Body of a TEXTURE_FRAME packet, sent for each texture frame.
TEXTURE_FIELDS = (
    Field("number", 16, "frame number; pattern and texture frames count together"),
    Field("skipped", 8, "frames skipped before this one because a buffer was full, at most 255"),
    Field("exposure_us", 16, "integration time, microseconds"),
    Field("timestamp_us", 24, "start of the integration, microseconds, modulo 2^24"),
    Field("bad_sync", 8, "frames that lost synchronism since the start, stops at 255"),
    Field("overrun", 8, "pixels lost between the clocks since the start, stops at 255"),
    Field("flags", 8, "see Flag"),
)


class Command(IntEnum):
    """First octet of a packet to the chip. The second is a tag, which the reply repeats."""

    IDENTIFY = 0x01  # no data; reply: IDENTITY_FIELDS
    WRITE = 0x02  # register (8 bits), value (32)
    READ = 0x03  # register (8); reply: its value as written, 32
    BEGIN = 0x04  # width (16), height (16), beams (16), TABLE_VERSION (8): a new set of tables
    TABLE = 0x05  # table (8), first word (16), words
    COMMIT = 0x06  # CRC-32 of every table's words, 32 each: check, swap at the next frame's start
    READ_TABLE = 0x07  # table (8), first word (16), number (8); reply: words of the new set
    STATUS = 0x08  # no data; reply: STATUS_FIELDS
    CAPTURE = 0x09  # milliseconds (16): laser without valid tables, at most that long; 0 ends it
    CLEAR = 0x0A  # clear the laser guard's causes


class Reason(IntEnum):
    """Third octet of a reply."""

    OK = 0  # carried out
    UNKNOWN_COMMAND = 1  # no command has this code
    WRONG_LENGTH = 2  # more or fewer octets than the command has
    UNKNOWN_REGISTER = 3  # no register has this address
    OUT_OF_RANGE = 4  # value, address or number
    OTHER_SENSOR = 5  # BEGIN for another sensor size, number of beams or version
    UNKNOWN_TABLE = 6  # no table has this number
    BUSY = 7  # a committed set waits for its frame, or a frame's spots are using the tables
    NO_BEGIN = 8  # TABLE or COMMIT without BEGIN
    DAMAGED_TABLE = 9  # COMMIT: the words in the memory have another CRC
    NOT_STOPPED = 10  # not while frames are taken: stop first (mode 0)
    DAMAGED_PACKET = 11  # wrong check; tag and command are then zero


class Mode(IntEnum):
    """Values of the register ``mode``."""

    STOP = 0  # no frames, laser off
    CONTINUOUS = 1  # pattern, texture, pattern, ...
    SINGLE = 2  # one pair, then stop
    PATTERN = 3  # pattern frames only


@dataclass(frozen=True)
class Register:
    """A register: address, name, bits (two's complement if signed), limits, reset value."""

    address: int
    name: str
    bits: int
    reset: int
    meaning: str
    low: int = 0
    high: int | None = None  # None: all values above `low`
    signed: bool = False  # all values are then allowed
    only_stopped: bool = False  # may be written only while the mode is 0


def registers(clock_hz=16_000_000, baud=115_200):
    """All registers, of a chip with that clock.

    A written value acts from the start of the next pattern frame at which no spot of an older
    frame is on its way; all that were written until then change together. Only ``mode`` 0 does not
    wait: no frame begins after it.
    """
    divisor = round(clock_hz / baud)
    return (
        Register(0x00, "mode", 2, 0, "0 stop, 1 continuous, 2 single pair, 3 pattern only"),
        Register(0x01, "period_us", 16, 40_000, "from pattern exposure to pattern exposure, "
                 "microseconds; longer if the frames need longer", low=1),
        Register(0x02, "pattern_reset_us", 16, 100, "sensor reset before the pattern", low=1),
        Register(0x03, "pattern_us", 16, 500, "integration of the pattern, laser on", low=1),
        Register(0x04, "texture_reset_us", 16, 100, "sensor reset before the texture", low=1),
        Register(0x05, "texture_us", 16, 10_000, "integration of the texture, laser off", low=1),
        Register(0x06, "pattern_as_texture", 1, 0,
                 "in mode 3, send pattern frames as texture frames, without points"),
        Register(0x07, "pattern_every", 4, 1, "measure one pattern frame in so many and leave the "
                 "others out; 0 is as 1"),
        Register(0x10, "threshold_fixed", 1, 0, "use `threshold_level` instead of the learnt one; "
                 "this and the next three in preset `paper` only"),
        Register(0x11, "threshold_level", 8, 0, "fixed threshold"),
        Register(0x12, "threshold_alpha", 8, 5 << 4,
                 "T = mean + threshold_alpha sigma, unsigned Q4.4"),
        Register(0x13, "erosion_mode", 2, 2, "0 off, 1 erode, 2 gate", high=2),
        Register(0x14, "weighted", 1, 1, "weigh pixels by what they exceed the lit level by, plus "
                 "1; preset `capsule` only"),
        Register(0x15, "area_min", 10, 2, "smallest area of a spot in pixels", low=1),
        Register(0x16, "area_max", 10, 1023, "largest area of a spot in pixels", low=1),
        Register(0x17, "report_rejected", 1, 0, "send rejected spots too, while the queue is less "
                 "than half full"),
        Register(0x18, "principal_u", 18, 0, "principal point, pixels; all coordinates have 9 "
                 "fraction bits, or 8 if the sensor is wider or higher than 512"),
        Register(0x19, "principal_v", 18, 0, "principal point, pixels; all coordinates have 9 "
                 "fraction bits, or 8 if the sensor is wider or higher than 512"),
        Register(0x1A, "tangential_1", 18, 0, "p1 over the focal length in pixels, times 2^27, "
                 "or 2^28 with 8 fraction bits", signed=True),
        Register(0x1B, "tangential_2", 18, 0, "p2 likewise", signed=True),
        Register(0x1C, "fixed_noise", 9, 0, "noise in eighths of a grey value instead of the "
                 "learnt one; 0 to learn it; this and the next three in preset `capsule` only"),
        Register(0x1D, "lit_gain", 6, 18, "lit level as a multiple of the noise, unsigned Q2.4",
                 low=1),
        Register(0x1E, "core_gain", 6, 24, "core level of the smoothed image, likewise", low=1),
        Register(0x1F, "dent_gain", 6, 4, "depth of a dent, likewise; 0 for no dents"),
        Register(0x20, "divisor", 16, divisor, "clocks per bit of the serial line", low=2,
                 only_stopped=True),
        Register(0x21, "full_records", 1, 0, "send points as records of 10 octets with beam and "
                 "1/z"),
        Register(0x22, "texture_enable", 1, 1, "send texture"),
        Register(0x23, "points_max", 9, 72, "ok points of a frame that are sent at most; "
                 "0 is no limit"),
        Register(0x24, "saturation", 8, 255, "grey value from which on a pixel is saturated; "
                 "preset `capsule` only", low=1),
        Register(0x25, "texture_bound", 3, 2, "largest error of a texture's pixel in grey values: "
                 "0, 2 or 4; 1 and 3 act as 0 and 2", high=4),
        Register(0x26, "texture_mosaic", 1, 0, "the sensor has a colour mosaic: texture is packed "
                 "as if a pixel resembled the one two to the left, not the one beside it"),
    )


@dataclass(frozen=True)
class Table:
    """A table: number, name, words, fields of a word (the lowest bits first), banks."""

    number: int
    name: str
    words: int | None  # None: as many as the sensor's size makes them
    fields: tuple
    banked: bool = True  # else writing needs mode 0, and makes the tables invalid

    @property
    def bits(self):
        """Bits of a word."""
        return sum(field.bits for field in self.fields)

    @property
    def octets(self):
        """Octets of a word on the wire."""
        return -(-self.bits // 8)

    def count(self, beams, pixels):
        """Words that a chip with so many beams and pixels takes."""
        return {"depth": 2 * beams, "beams": beams, "remap": -(-pixels // 4)}.get(
            self.name, self.words)


#: Tables of every chip, in the order of their CRCs in COMMIT. `words` of depth and beams are those
#: of MOST_BEAMS; a chip with K beams takes 2 K and K, and no others. The CRC-32 (ISO-HDLC) goes
#: over the words' octets as TABLE carries them.
TABLES = (
    Table(0, "depth", 2 * MOST_BEAMS, (
        Field("depth", 36, "2k: alpha of beam k, signed 18 bits, 12 of them fraction; 2k + 1: "
              "beta, signed 36 bits, 12 of them fraction; 1/z = alpha x + beta"),)),
    Table(1, "reciprocal", 256, (
        Field("reciprocal", 36, "see model/preprocessing/centre.py"),), banked=False),
    Table(2, "radial", 1024, (
        Field("radial", 18, "radial scale, see model/stereo/undistort.py"),)),
    Table(3, "beams", MOST_BEAMS, (
        Field("line", 36, "line k: slope, signed Q0.17, 18 bits; offset, a signed "
              "coordinate, 18"),
        Field("window", 36, "tolerance, unsigned, 9 bits, in 16 LSBs of a coordinate (0 disables "
              "the beam); least and largest x, signed, 13 bits each, in 32 LSBs; 1 bit zero"))),
)
#: The preset ``paper`` has one more, in its external memory.
REMAP = Table(4, "remap", None, (
    Field("even", 32, "positions of two pixels of the corrected image, see model/preprocessing/"
          "remap.py"),
    Field("odd", 32, "of the next two; preset `paper` only")), banked=False)


def tables(preset):
    """Tables of a preset, in the order of their CRCs in COMMIT."""
    return (*TABLES, REMAP) if preset == "paper" else TABLES


#: Causes that the laser guard holds until CLEAR, bits of ``guard_causes``.
GUARD_CAUSES = (
    "pulse",  # longer than the ceiling
    "repetition",  # too soon after the pulse before
    "duty",  # too much light in the window
    "not_armed",  # light was requested without valid tables or capture
    "heartbeat",  # frames stopped arriving
    "upset",  # a bit flipped in the guard's own registers; it began again as after a reset
)

#: The laser guard's limits in microseconds, which no register changes.
GUARD_LIMITS_US = {
    "pulse": 1000,  # a pulse lasts no longer
    "repetition": 20_000,  # from the start of a pulse to that of the next, at least
    "window": 40_000,  # any time as long as this ...
    "window_on": 1000,  # ... holds no more light than this
    "heartbeat": 60_000,  # from a whole frame to the next, at most
}

#: Reply to IDENTIFY.
IDENTITY_FIELDS = (
    Field("protocol", 8, "PROTOCOL_VERSION"),
    Field("tables", 8, "TABLE_VERSION"),
    Field("width", 16, "sensor width, pixels"),
    Field("height", 16, "sensor height, pixels"),
    Field("beams", 16, "beams of the mesh"),
    Field("lanes", 8, "epipolar lines compared at a time"),
    Field("preset", 8, "0 capsule, 1 paper"),
    Field("clock_khz", 16, "system clock"),
)

#: Reply to STATUS. Counters of 8 and 16 bits stop at their largest value.
STATUS_FIELDS = (
    Field("state", 8, "bit 0 tables valid, 1 laser armed, 2 calibration capture, 3 commit waits "
                      "for its frame, 4 active bank, 5 and 6 mode, 7 sensor silent"),
    Field("guard_causes", 8, "see GUARD_CAUSES"),
    Field("pairs", 16, "pattern exposures since the start, modulo 65536"),
    Field("timeouts", 8, "frames that the sensor did not send in time"),
    Field("bad_sync", 8, "frames that lost synchronism"),
    Field("overrun", 8, "pixels lost between the clocks"),
    Field("skipped", 8, "frames skipped because a buffer was full"),
    Field("accepted", 16, "commands carried out"),
    Field("refused", 16, "commands refused"),
    Field("damaged", 16, "packets from the host with a wrong check"),
    Field("framing", 8, "characters from the host without a stop bit"),
    Field("packets", 16, "packets sent, modulo 65536"),
    Field("late", 8, "pairs that began later than `period_us` after the one before"),
    Field("display", 8, "faults of the display of the preset `paper`, see DISPLAY_FAULTS"),
)

#: Faults of the display since reset, bits of ``display``.
DISPLAY_FAULTS = (
    "frame",  # the end of a frame was lost because the memory was too slow
    "row",  # a row arrived from the frame store too late
    "overlay",  # a frame had more spots than the overlay draws
)
