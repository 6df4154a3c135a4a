# amaranth: UnusedElaboratable=no
"""The port of the external memory, and the two models of the memory against each other."""

import pytest

from hdl.common.sram import SRAMPort
from tb.common.sram_chip import SRAMChip
from tb.hdlsim import run


@pytest.mark.parametrize(("clients", "seed"), [(1, 1), (3, 2), (3, 3)])
def test_sram(request, clients, seed):
    run(request, "sram", "tb.common.tb_sram", component=SRAMPort(clients),
        parameters={"clients": clients, "seed": seed})


def test_models_of_the_memory(request):
    run(request, "sram_chip", "tb.common.tb_sram_chip", component=SRAMChip(8))


@pytest.mark.parametrize("clients", [0, 17, 1.0, "foo"])
def test_bad_clients(clients):
    with pytest.raises(ValueError, match="Clients must be an integer from 1 to 16, not "):
        SRAMPort(clients)
