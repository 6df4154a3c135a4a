"""Paths between clock domains that are known to be safe, and why."""

import re
from dataclasses import dataclass

__all__ = ["WAIVERS", "Waiver"]


@dataclass(frozen=True)
class Waiver:
    """A kind of path that is known to be safe.

    Parameters
    ----------
    source, destination : :class:`str`
        Regular expressions for the names of both ends.
    why : :class:`str`
        The reason why it is safe.
    chain : :class:`bool`
        Require the form of a synchroniser: no logic before its first flip-flop, nor between that
        and the next.
    bounded : :class:`bool`
        Whether what is sampled must be there within a clock of the faster side, as a Gray code must
        and data that a handshake announces. Otherwise the path takes any time: one bit, or a reset.
    """

    source: str
    destination: str
    why: str
    chain: bool = False
    bounded: bool = True

    def fits(self, crossing):
        """Whether a :class:`scripts.rtl.crossings.Crossing` is of this kind."""
        return (re.fullmatch(self.source, crossing.source) is not None
                and re.fullmatch(self.destination, crossing.destination) is not None
                and (not self.chain or (crossing.direct and crossing.lone)))


_GRAY = ("Gray code through two flip-flops: one bit changes at a time, so the sample is the number "
         "before or after")
_LINE = "one bit through two flip-flops; it is held until it is acknowledged"
_STABLE = "stable while it is sampled, which a handshake through two flip-flops ensures"
#: All of them, by the block that they belong to.
WAIVERS = (
    # amaranth.lib.fifo.AsyncFIFO, between the imager's pixel clock and the system's.
    Waiver(r".*queue\.produce_w_gry", r".*queue\.produce_cdc\.stage0", _GRAY, chain=True),
    Waiver(r".*queue\.consume_r_gry", r".*queue\.consume_cdc\.stage0", _GRAY, chain=True),
    Waiver(r".*queue\.storage", r".*queue\.storage_r_data",
           "a word is read only after the writer's count includes it, and not written again until "
           "the reader's count shows that it was read"),
    Waiver(r"pin pixel_rst", r".*queue\.(rst_cdc\.stage0|r_rst)",
           "asynchronous assertion, released through two flip-flops", bounded=False),
    # Pins.
    Waiver(r"pin rx", r"(.*\.)?synchroniser\.stage0", "two flip-flops", chain=True, bounded=False),
    Waiver(r"pin cts", r"(.*\.)?cts_synchronizer\.stage0", "two flip-flops", chain=True,
           bounded=False),
    Waiver(r"pin frame_valid", r"(.*\.)?sending_synchronizer\.stage0", "two flip-flops",
           chain=True, bounded=False),
    # hdl.acquisition.frame_banks, between the system's clock and the display's.
    Waiver(r"(.*(banks|frames)\.)?request", r"(.*(banks|frames)\.)?request\.stage0", _LINE,
           chain=True, bounded=False),
    Waiver(r"(.*(banks|frames)\.)?answer", r"(.*(banks|frames)\.)?answer\.stage0", _LINE,
           chain=True, bounded=False),
    Waiver(r"(.*banks\.)?wants", r"(.*banks\.)?(reader|reader_exists|reader_info|"
           r"reader_is_fresh|newest_is_unread|write_bank|free)", _STABLE),
    Waiver(r"(.*banks\.)?reader(_exists|_info|_is_fresh)?", r"(.*banks\.|.*)?(held|fresh|frame|"
           r"read_bank|list_number)", _STABLE),
    Waiver(r"(.*\.)?(bank_\d+_page_\d+|diamonds)", r"(.*\.)?(bank_\d+_page_\d+|diamonds)_r_data",
           "no bank is written while the reader holds it (`make prove`); data read from others is "
           "not used"),
    Waiver(r"(.*\.)?row_late", r"(.*\.)?late_synchronizer\.stage0",
           "one bit through two flip-flops; it is never cleared", chain=True, bounded=False),
    # hdl.acquisition.sram_frames, likewise.
    Waiver(r"(.*\.)?(wanted|read_bank)", r"(.*\.)?(odd|read_address)", _STABLE),
    Waiver(r"(.*\.)?line", r"(.*\.)?line_r_data",
           "a row is shown only once it has arrived, and its half is filled only after the next "
           "row for it was requested; data read before is not used"),
)
