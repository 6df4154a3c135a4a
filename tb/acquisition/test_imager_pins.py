import pytest

from tb.acquisition.imager_pins import ImagerPins
from tb.hdlsim import run

#: Pins and nothing else.
BOARD = """
module board(
    input pixel_clk, input sensor_reset, input sensor_integrate, input sensor_read, input laser,
    input frame_valid, input line_valid, input [7:0] data, output any_pin
);
    assign any_pin = ^{pixel_clk, sensor_reset, sensor_integrate, sensor_read, laser, frame_valid,
                       line_valid, data};
endmodule
"""


def test_imager_pins(request):
    run(request, "board", "tb.acquisition.tb_imager_pins", verilog={"board.v": BOARD})


@pytest.mark.parametrize("blanking", [-1, 49])
def test_refuses_blanking(blanking):
    with pytest.raises(ValueError) as caught:
        ImagerPins(None, None, blanking=blanking)
    assert str(caught.value) == f"Line blanking must be 0 to 48 pixel clocks, not {blanking}"
