"""The parts and boards that designs are exported for, and whether a design fits a part."""

from dataclasses import dataclass, field

from scripts.rtl.synthesis import FAMILIES

__all__ = ["BOARDS", "FLOWS", "PARTS", "Board", "Part", "boards_of", "lacks", "lacks_bits"]


@dataclass(frozen=True)
class Part:
    """A part and what it has of each resource, by its data sheet.

    ``family`` is that of :data:`scripts.rtl.synthesis.FAMILIES`, ``capacity`` names its resources,
    ``bits`` is what its block memories hold.
    """

    name: str
    family: str
    capacity: dict
    bits: int

    def share(self, resource, used):
        """Part of the device in percent; None if it has none of this."""
        return 100 * used / self.capacity[resource] if self.capacity.get(resource) else None


def _part(name, family, lut, ff, multiplier, memory, small=0):
    capacity = {"lut": lut, "ff": ff, "multiplier": multiplier, "memory": memory}
    block = {"xc7": 36_864, "proasic3e": 4_608}.get(family, 18_432)
    return Part(name, family, capacity | ({"small memory": small} if small else {}),
                memory * block + small * 1_152)


#: All parts by name. A tile of ProASIC3E is a table or a flip-flop.
PARTS = {part.name: part for part in (
    _part("XC2VP30", "xc2vp", 27_392, 27_392, 136, 136),
    _part("XC7A35T", "xc7", 20_800, 41_600, 90, 50),
    _part("XC7A100T", "xc7", 63_400, 126_800, 240, 135),
    _part("XC7Z020", "xc7", 53_200, 106_400, 220, 140),
    _part("M2GL025", "polarfire", 27_696, 27_696, 34, 31, 34),
    _part("M2S025", "polarfire", 27_696, 27_696, 34, 31, 34),
    _part("A3PE3000", "proasic3e", 75_264, 75_264, 0, 112),
    _part("LFE5U-25F", "ecp5", 24_288, 24_288, 28, 56),
    _part("LFE5U-45F", "ecp5", 43_848, 43_848, 72, 108),
    _part("LFE5U-85F", "ecp5", 83_640, 83_640, 156, 208),
)}


@dataclass(frozen=True)
class Board:
    """A board, its part as the vendor's tool spells it, and the pins that are known.

    Parameters
    ----------
    name, title : :class:`str`
        Stem of its files; what people call it, empty for a part without a board.
    part : :class:`str`
        Of :data:`PARTS`.
    device : dict
        Names that the vendor's tool has for it.
    oscillator_hz : :class:`int`
        Of the clock at its pin ``clock_in``.
    clocks : :class:`str`
        How the top makes the design's clocks of it, see :mod:`.board_top`.
    reset_low : :class:`bool`
        Whether the pin ``reset_in`` resets while it is low.
    pins : dict
        Sites by pin; a vector has one for each bit.
    unsure : dict
        Sites that are to be compared with the board's schematic; they are written as comments.
    """

    name: str
    title: str
    part: str
    device: dict
    oscillator_hz: int
    clocks: str
    reset_low: bool = False
    standard: str = "LVCMOS33"
    pins: dict = field(default_factory=dict)
    unsure: dict = field(default_factory=dict)


_ARTY = {
    "clock_in": "E3", "reset_in": "C2", "rx": "A9", "tx": "D10", "busy": "H5",
    "sensor_reset": "G13", "sensor_integrate": "B11", "sensor_read": "A11", "laser": "D12",
    "cts": "D13", "frame_valid": "D4", "line_valid": "D3", "pixel_clk": "F4",
    "data": "E15 E16 D15 C15 J17 J18 K15 J15".split(),
}
#: Header J1: gn0 takes the imager's clock, the others follow in their order.
_ULX3S = {
    "clock_in": "G2", "reset_in": "R1", "rx": "M1", "tx": "L4", "busy": "B2", "pixel_clk": "C11",
    "frame_valid": "A10", "line_valid": "A11", "data": "A9 B10 B9 C10 A7 A8 C8 B8".split(),
    "laser": "C6", "sensor_reset": "C7", "sensor_integrate": "A6", "sensor_read": "B6",
    "cts": "A4",
}
_CREATIVE = {"clock_in": "H16", "reset_in": "H12", "tx": "G3", "rx": "H3"}
#: System clocks of each flow, hertz: what its boards make of their oscillators.
FLOWS = {
    "generic": 16_000_000, "xilinx-ise": 16_000_000, "xilinx-vivado": 16_000_000,
    "libero": 10_000_000, "lattice-ecp5": 16_000_000,
}
#: Boards by flow.
BOARDS = {
    "xilinx-ise": (
        Board("xup_v2p", "XUP Virtex-II Pro Development System", "XC2VP30",
              {"family": "virtex2p", "device": "xc2vp30", "package": "ff896", "speed": "-7"},
              100_000_000, "dcm", reset_low=True, standard="LVCMOS25", unsure={
                  "clock_in": "AJ15", "reset_in": "AH5", "rx": "AJ8", "tx": "AE7",
                  "busy": "AC4"}),),
    "xilinx-vivado": (
        Board("arty_a7_35", "Digilent Arty A7-35T", "XC7A35T", {"part": "xc7a35ticsg324-1L"},
              100_000_000, "mmcm", reset_low=True, pins=_ARTY),
        Board("arty_a7_100", "Digilent Arty A7-100T", "XC7A100T", {"part": "xc7a100tcsg324-1"},
              100_000_000, "mmcm", reset_low=True, pins=_ARTY),
        Board("pynq_z1", "Digilent PYNQ-Z1, its programmable logic alone", "XC7Z020",
              {"part": "xc7z020clg400-1"}, 125_000_000, "mmcm", pins={
                  "clock_in": "H16", "reset_in": "D19", "busy": "R14"})),
    "libero": (
        Board("creative_igloo2", "Future Electronics Creative Board with IGLOO2", "M2GL025",
              {"family": "IGLOO2", "die": "M2GL025", "package": "256 VF", "speed": "STD",
               "voltage": "1.2"}, 50_000_000, "divide", reset_low=True, unsure=_CREATIVE),
        Board("creative_smartfusion2", "Future Electronics Creative Board with SmartFusion2",
              "M2S025",
              {"family": "SmartFusion2", "die": "M2S025", "package": "256 VF", "speed": "STD",
               "voltage": "1.2"}, 50_000_000, "divide", reset_low=True, unsure=_CREATIVE),
        Board("a3pe3000", "", "A3PE3000",
              {"family": "ProASIC3E", "die": "A3PE3000", "package": "484 FBGA", "speed": "STD",
               "voltage": "1.5"}, 50_000_000, "divide", reset_low=True)),
    "lattice-ecp5": tuple(
        Board(f"ulx3s_{size}", f"Radiona ULX3S with LFE5U-{size}F", f"LFE5U-{size}F",
              {"option": f"--{size}k", "package": "CABGA381", "speed": 6}, 25_000_000, "pll",
              pins=_ULX3S)
        for size in (25, 45, 85)),
}


def boards_of(flow, part=None):
    """Boards of a flow, or those of one of its parts."""
    return [board for board in BOARDS.get(flow, ()) if part in (None, board.part)]


def lacks_bits(part, bits):
    """Whether ``bits`` of memory are more than the ``part`` has, in words, or None."""
    return (f"{part.name} is too small: {bits:,} bits of memory are needed and it has "
            f"{part.bits:,}" if bits > part.bits else None)


def lacks(part, used):
    """What the ``part`` has too little of for a design that uses ``used``, in words, or None."""
    units = FAMILIES[part.family].units
    short = [f"{used[name]:,} {units.get(name, 'flip-flops')} are needed and it has {has:,}"
             for name, has in part.capacity.items() if used.get(name, 0) > has]
    return f"{part.name} is too small: {'; '.join(short)}" if short else None
