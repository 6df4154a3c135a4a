// For simulation only: a sensor that plays stored frames, the capsule, and the reader's end of the
// serial line. The clock runs in here, so that a bench wakes only for octets and whole frames.
`timescale 1ns / 1ps

module rig #(
    parameter WIDTH = 352,
    parameter HEIGHT = 288,
    parameter FRAMES = 32
);

    // The same clock for pixels and system: one pixel a clock.
    reg clk = 0;
    reg rst = 1;
    always #5 clk = ~clk;

    // Sensor. `frames` frames are shown from `first` on once `start` rises; then `done` is high.
    // In frame `faulty`, line `fault_row` has `fault_extra` pixels too many, or too few if
    // negative; `fault_lines` lines are missing at its end.
    reg [7:0] pixels [0:FRAMES*WIDTH*HEIGHT-1];
    reg start = 0;
    reg done = 0;
    reg [15:0] first = 0;
    reg [15:0] frames = 0;
    reg [15:0] line_blanking = 0;
    reg [15:0] frame_blanking = 16;
    reg [15:0] faulty = 16'hffff;
    reg [15:0] fault_row = 0;
    reg signed [15:0] fault_extra = 0;
    reg [15:0] fault_lines = 0;

    reg frame_valid = 0;
    reg line_valid = 0;
    reg [7:0] data = 0;
    integer frame, row, column, length, rows;
    reg [1023:0] file;

    initial begin
        if ($value$plusargs("pixels=%s", file)) $readmemh(file, pixels);
        forever begin
            @(posedge start);
            done <= 0;
            for (frame = first; frame < first + frames; frame = frame + 1) begin
                rows = HEIGHT;
                if (frame == faulty) rows = HEIGHT - fault_lines;
                for (row = 0; row < rows; row = row + 1) begin
                    length = WIDTH;
                    if (frame == faulty && row == fault_row) length = WIDTH + fault_extra;
                    for (column = 0; column < length; column = column + 1) begin
                        @(posedge clk);
                        frame_valid <= 1;
                        line_valid <= 1;
                        data <= pixels[(frame * HEIGHT + row) * WIDTH + column % WIDTH];
                    end
                    if (line_blanking != 0) begin
                        @(posedge clk);
                        line_valid <= 0;
                        repeat (line_blanking - 1) @(posedge clk);
                    end
                end
                @(posedge clk);
                frame_valid <= 0;
                line_valid <= 0;
                repeat (frame_blanking) @(posedge clk);
            end
            done <= 1;
        end
    end

    // Registers and tables, driven by the bench.
    reg threshold_fixed = 0;
    reg [7:0] threshold_level = 0;
    reg [7:0] alpha = 0;
    reg [1:0] erosion_mode = 0;
    reg weighted = 0;
    reg [7:0] area_min = 0;
    reg [7:0] area_max = 0;
    reg report_rejected = 0;
    reg [17:0] principal_u = 0;
    reg [17:0] principal_v = 0;
    reg [17:0] tangential_1 = 0;
    reg [17:0] tangential_2 = 0;
    reg [15:0] divisor = 1;
    reg table_enable = 0;
    reg [1:0] table_select = 0;
    reg [9:0] table_address = 0;
    reg [71:0] table_data = 0;
    wire tx;

    capsule capsule (
        .clk(clk), .rst(rst), .pixel_clk(clk), .pixel_rst(rst),
        .frame_valid(frame_valid), .line_valid(line_valid), .data(data), .tx(tx),
        .threshold_fixed(threshold_fixed), .threshold_level(threshold_level), .alpha(alpha),
        .erosion_mode(erosion_mode), .weighted(weighted), .area_min(area_min),
        .area_max(area_max), .report_rejected(report_rejected), .principal_u(principal_u),
        .principal_v(principal_v), .tangential_1(tangential_1), .tangential_2(tangential_2),
        .divisor(divisor), .table_enable(table_enable), .table_select(table_select),
        .table_address(table_address), .table_data(table_data)
    );

    // Serial receiver, 8N1: `octet` is new whenever `octets` changes.
    reg [7:0] octet = 0;
    reg [31:0] octets = 0;
    reg framing_error = 0;
    reg [7:0] shift;
    integer bit_number;

    initial begin
        forever begin
            @(posedge clk);
            if (!rst && !tx) begin
                // To the middle of the start bit, then from bit to bit.
                repeat (divisor / 2) @(posedge clk);
                for (bit_number = 0; bit_number < 8; bit_number = bit_number + 1) begin
                    repeat (divisor) @(posedge clk);
                    shift = {tx, shift[7:1]};
                end
                repeat (divisor) @(posedge clk);
                if (!tx) framing_error <= 1;
                octet <= shift;
                octets <= octets + 1;
            end
        end
    end

endmodule
