# amaranth: UnusedElaboratable=no
"""Registers reach the blocks that use them, as wide and as signed as the protocol has them."""

import pytest
from amaranth.hdl import Shape

from hdl.acquisition.sequencer import Sequencer
from hdl.capsule import Capsule
from hdl.config import PRESETS
from hdl.link.commands import Commands
from hdl.link.point_limiter import PointLimiter
from hdl.link.registers import Registers
from hdl.paper import Paper
from hdl.ports import TABLE_PORT, register_ports, register_shape
from hdl.preprocessing.erosion import Erosion
from hdl.preprocessing.labelling import Labelling
from hdl.preprocessing.noise import Noise
from hdl.preprocessing.threshold import Threshold
from hdl.protocol import registers

SHAPES = {register.name: register_shape(register) for register in registers()}
#: Blocks whose inputs have other names than the registers.
RENAMED = {
    "threshold_alpha": (Threshold(64, 64), "threshold_alpha"),
    "threshold_fixed": (Threshold(64, 64), "fixed"),
    "threshold_level": (Threshold(64, 64), "fixed_level"),
    "erosion_mode": (Erosion(64), "mode"),
    "fixed_noise": (Noise(64, 64), "fixed_noise"),
    "weighted": (Labelling(64, 64), "weighted"),
    "points_max": (PointLimiter(), "limit"),
}


@pytest.mark.parametrize("top", [Capsule, Paper])
def test_every_register_is_used(top):
    unused = {
        Paper: {"weighted", "fixed_noise", "lit_gain", "core_gain", "dent_gain", "saturation"},
        Capsule: {"threshold_fixed", "threshold_level", "threshold_alpha", "erosion_mode"}}[top]
    assert {*Sequencer.registers, *top.registers} == SHAPES.keys() - unused
    assert not Sequencer.registers.keys() & top.registers.keys()


@pytest.mark.parametrize("component", [
    Registers(), Commands(64, 64, 4, 2), Sequencer(), Capsule(PRESETS["capsule"]),
    Paper(PRESETS["paper"])], ids=lambda component: type(component).__name__)
def test_ports_have_the_widths_of_the_protocol(component):
    members = component.signature.members
    common = SHAPES.keys() & set(members)
    assert len(common) >= 7
    for name in common:
        assert Shape.cast(members[name].shape) == SHAPES[name], name


@pytest.mark.parametrize("name", RENAMED)
def test_inputs_of_another_name_have_the_widths_of_the_protocol(name):
    component, port = RENAMED[name]
    assert Shape.cast(component.signature.members[port].shape) == SHAPES[name]


def test_table_port_is_the_one_of_the_commands():
    ours = Commands(64, 64, 4, 2).signature.members
    for name, member in TABLE_PORT.items():
        assert Shape.cast(ours[name].shape) == Shape.cast(member.shape), name
        assert ours[name].flow != member.flow, name


def test_unknown_register_is_refused():
    with pytest.raises(LookupError) as caught:
        register_ports("area_min", "foo")
    assert str(caught.value) == "The protocol has no register 'foo'"
