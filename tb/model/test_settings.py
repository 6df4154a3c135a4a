"""Registers and tables of the settings, packed and unpacked."""

import random
from dataclasses import replace

import pytest

from hdl.protocol import REMAP, TABLES, registers
from model.settings import EROSION_MODES, Settings
from tb.system.stimuli import any_settings


@pytest.mark.parametrize("erosion", EROSION_MODES)
@pytest.mark.parametrize("level, noise", [(None, 0), (90, 77)])
def test_a_chip_gives_back_what_it_was_loaded_with(erosion, level, noise):
    settings = any_settings(64, 64, 5, 3, erosion=erosion, level_fixed=level, fixed_noise=noise)
    settings = replace(settings, tangential_1=-3, tangential_2=(1 << 17) - 1)
    assert Settings.from_chip(settings.registers(), settings.tables()) == settings


def test_registers_are_those_of_the_protocol():
    values = Settings(tangential_1=-1, tangential_2=-(1 << 17)).registers()
    assert (values["tangential_1"], values["tangential_2"]) == ((1 << 18) - 1, 1 << 17)
    widths = {register.name: register.bits for register in registers()}
    assert set(values) < set(widths)
    assert all(0 <= value < 1 << widths[name] for name, value in values.items())
    resets = {register.name: register.reset for register in registers()}
    assert Settings().registers() == {name: resets[name] for name in Settings().registers()}


def test_words_hold_their_fields_from_the_lowest_bits_on():
    rng = random.Random(1)
    line, window = ([rng.getrandbits(36) for _ in range(4)] for _ in range(2))
    settings = Settings(depth=(1, -1), reciprocal=(2,), radial=(3,), line=line, window=window,
                        remap=(0, 1, 2, 3, 4, 5))
    words = settings.tables()
    assert words["beams"] == [low | high << 36 for low, high in zip(line, window, strict=True)]
    assert words["depth"] == [1, (1 << 36) - 1]
    assert list(words) == [*(table.name for table in TABLES), REMAP.name]
    assert len(words["remap"]) == 2 and words["remap"][1] >> 32 == 0
