// For simulation only: an imager, a laser driver and the host's end of the serial line around the
// instrument. Clocks run in here; a bench wakes for octets and for pictures, which it makes from
// what the imager counted.
`timescale 1ns / 1ps

module instrument_rig #(
    parameter WIDTH = 352,
    parameter HEIGHT = 288,
    parameter PIXEL_HALF_PS = 62500,
    parameter DIVISOR = 139
);

    // System clock of 16 MHz, and the imager's own.
    reg clk = 0;
    reg pixel_clk = 0;
    reg rst = 1;
    always #31.25 clk = !clk;
    always #(PIXEL_HALF_PS / 1000.0) pixel_clk = !pixel_clk;

    wire sensor_reset, sensor_integrate, sensor_read, laser, tx, busy;
    reg cts = 1;

    // An AC-coupled driver: light while the pin moves, dark four clocks after it stands still.
    reg pin = 0;
    reg [2:0] hold = 0;
    wire light = hold != 0;
    always @(posedge clk) begin
        pin <= laser;
        if (laser != pin) hold <= 4;
        else if (hold != 0) hold <= hold - 1;
    end

    // What the laser did: longest pulse, shortest time from rise to rise, pulses, in clocks.
    reg [31:0] lit_for = 0, longest = 0, since_rise = 32'h7fffffff, closest = 32'h7fffffff;
    reg [31:0] pulses = 0;
    always @(posedge clk) begin
        lit_for <= light ? lit_for + 1 : 0;
        if (lit_for > longest) longest <= lit_for;
        if (light && lit_for == 0) begin
            pulses <= pulses + 1;
            since_rise <= 1;
            if (since_rise < closest) closest <= since_rise;
        end else if (since_rise != 32'h7fffffff) since_rise <= since_rise + 1;
    end

    // The imager integrates between its reset and its read-out. `exposures` counts read-outs asked
    // for; the bench then makes the picture, and raises `go` when it is in the file.
    reg [31:0] integrated = 0, lit = 0, exposures = 0;
    reg read_before = 0;
    reg [1023:0] picture;
    reg [7:0] pixels [0:WIDTH*HEIGHT-1];
    reg go = 0;
    initial if (!$value$plusargs("picture=%s", picture)) $fatal(1, "no picture");
    always @(posedge clk) begin
        read_before <= sensor_read;
        if (sensor_reset) begin
            integrated <= 0;
            lit <= 0;
        end else if (sensor_integrate) begin
            integrated <= integrated + 1;
            if (light) lit <= lit + 1;
        end
        if (sensor_read && !read_before) exposures <= exposures + 1;
    end

    reg [15:0] line_blanking = 0;
    reg [31:0] row = HEIGHT, column = 0, address = 0;
    reg gone = 0;
    reg frame_valid = 0, line_valid = 0;
    reg [7:0] data = 0;
    always @(posedge pixel_clk) begin
        gone <= go;
        frame_valid <= row < HEIGHT;
        line_valid <= row < HEIGHT && column < WIDTH;
        if (row < HEIGHT) begin
            if (column < WIDTH) begin
                data <= pixels[address];
                address <= address + 1;
            end
            column <= column + 1;
            if (column == WIDTH + 32'(line_blanking) - 1) begin
                column <= 0;
                row <= row + 1;
            end
        end else if (go && !gone) begin
            $readmemh(picture, pixels);
            row <= 0;
            column <= 0;
            address <= 0;
        end
    end

    // From the host: `send` one octet at a time; `sent` follows.
    reg rx = 1;
    reg [7:0] send_octet = 0;
    reg [31:0] send = 0, sent = 0;
    reg [31:0] rx_left = 0;
    reg [3:0] rx_bits = 0;
    reg [9:0] rx_shift = 0;
    always @(posedge clk) begin
        if (rx_left != 0) rx_left <= rx_left - 1;
        else if (rx_bits != 0) begin
            rx <= rx_shift[0];
            rx_shift <= {1'b1, rx_shift[9:1]};
            rx_bits <= rx_bits - 1;
            rx_left <= DIVISOR - 1;
            if (rx_bits == 1) sent <= sent + 1;
        end else if (send != sent) begin
            rx_shift <= {1'b1, send_octet, 1'b0};
            rx_bits <= 10;
        end
    end

    // To the host: `octet` is new whenever `octets` changes.
    reg [7:0] octet = 0, shift = 0;
    reg [31:0] octets = 0, left = 0;
    reg [3:0] bits = 0;
    reg framing_error = 0;
    always @(posedge clk) begin
        if (bits == 0) begin
            if (!rst && !tx) begin
                bits <= 9;
                left <= DIVISOR + DIVISOR / 2 - 1;
            end
        end else if (left != 0) left <= left - 1;
        else begin
            bits <= bits - 1;
            left <= DIVISOR - 1;
            if (bits != 1) shift <= {tx, shift[7:1]};
            else begin
                framing_error <= framing_error | !tx;
                octet <= shift;
                octets <= octets + 1;
            end
        end
    end

    instrument instrument (
        .clk(clk), .rst(rst), .pixel_clk(pixel_clk), .pixel_rst(rst), .busy(busy),
        .sensor_reset(sensor_reset), .sensor_integrate(sensor_integrate),
        .sensor_read(sensor_read), .laser(laser),
        .frame_valid(frame_valid), .line_valid(line_valid), .data(data),
        .rx(rx), .cts(cts), .tx(tx)
    );

endmodule
