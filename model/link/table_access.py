"""The words of all tables, as the host reaches them."""

import zlib

from hdl.protocol import tables

__all__ = ["TableStore"]


class TableStore:
    """All tables of a chip, in two banks where there are two.

    Parameters
    ----------
    preset : :class:`str`
        One of :data:`hdl.protocol.PRESET_NAMES`.
    beams, pixels : :class:`int`
        Sizes of the chip.

    Attributes
    ----------
    kinds : tuple of :class:`hdl.protocol.Table`
        The tables, by number.
    counts : list of :class:`int`
        Words of each.
    bank : :class:`int`
        Bank that acts; the host has the other one.
    """

    def __init__(self, preset, beams, pixels):
        self.kinds = tables(preset)
        self.counts = [table.count(beams, pixels) for table in self.kinds]
        self.bank = 0
        first = [[0] * count for count in self.counts]
        # Both banks hold the same list of a table that has one bank.
        self._banks = [first, [list(words) if table.banked else words
                               for table, words in zip(self.kinds, first, strict=True)]]

    def words(self, number, acting=False):
        """Words of a table, in the bank that acts or in the host's."""
        return self._banks[self.bank if acting else 1 - self.bank][number]

    def write(self, number, address, word):
        """Write a word of the host's bank; bits above the table's are not kept."""
        self.words(number)[address] = word & ((1 << self.kinds[number].bits) - 1)

    def octets(self, number, first, count):
        """Octets of words of the host's bank, as they are on the wire."""
        size = self.kinds[number].octets
        return b"".join(word.to_bytes(size, "little")
                        for word in self.words(number)[first:first + count])

    def checks(self):
        """The CRC-32 of each table in the host's bank."""
        return [zlib.crc32(self.octets(table.number, 0, count))
                for table, count in zip(self.kinds, self.counts, strict=True)]

    def swap(self):
        """Swap the banks."""
        self.bank ^= 1
