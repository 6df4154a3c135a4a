// For simulation only: a camera and a reader around the frame memory, each with a clock of its own.
// Every pixel has its frame's number, so that a reader sees at once when another frame shows
// through. Both sides run in here; a bench sets them up, waits, and looks at the counters.
`timescale 1ns / 1ps

module frame_memory_rig #(
    parameter WIDTH = 7,
    parameter HEIGHT = 5
);
    localparam PIXELS = WIDTH * HEIGHT;

    reg [31:0] sync_ps = 40000;
    reg [31:0] display_ps = 40000;
    reg [31:0] offset_ps = 0;
    reg clk = 0;
    reg display_clk = 0;
    reg rst = 1;
    reg display_rst = 1;
    reg running = 0;
    always @(posedge running) while (running) begin
        #(sync_ps / 2000.0) clk = 1;
        #(sync_ps / 2000.0) clk = 0;
    end
    always @(posedge running) begin
        #((offset_ps + 1) / 1000.0);
        while (running) begin
            #(display_ps / 2000.0) display_clk = 1;
            #(display_ps / 2000.0) display_clk = 0;
        end
    end

    function [7:0] pixel(input [15:0] number, input [31:0] address);
        reg [31:0] mixed;
        begin
            mixed = ({16'd0, number} * 32'h9e3779b1) ^ ((address + 32'd1) * 32'h85ebca6b);
            mixed = (mixed ^ (mixed >> 15)) * 32'hc2b2ae35;
            pixel = mixed[31:24];
        end
    endfunction

    function [31:0] next(input [31:0] state);
        reg [31:0] value;
        begin
            value = state ^ (state << 13);
            value = value ^ (value >> 17);
            next = value ^ (value << 5);
        end
    endfunction

    wire idle, held, fresh;
    wire [16:0] frame;
    wire [7:0] data, broken, skipped, unread;

    // Camera. Chances in 256: of a clock without a pixel, and of a frame that breaks off or has
    // another size; so many clocks, at most, between frames.
    reg [31:0] seed = 1;
    reg [7:0] gap = 0;
    reg [7:0] faulty = 0;
    reg [15:0] blanking = 0;
    reg [31:0] frames = 0;  // to be shown
    reg [31:0] shown = 0;
    reg [31:0] whole = 0;
    reg [31:0] faults = 0;
    reg [15:0] newest = 0;  // number of the last whole frame that was not skipped
    reg [7:0] skipped_before = 0;
    reg [15:0] number = 0;
    reg i_valid = 0;
    reg [10:0] i_payload = 0;
    reg [16:0] info = 0;
    reg [31:0] dice = 1;
    reg [31:0] address = 0;
    reg [31:0] length = PIXELS;
    reg breaks = 0;
    reg [31:0] pause = 20;
    reg good = 0;  // the frame that ends now is whole
    reg begun = 0;  // ... has a pixel
    wire [15:0] current = number + 16'd1;
    wire [31:0] strange = {20'd0, dice[19:8]} % (2 * PIXELS + 1);
    reg [31:0] tail = 2000;  // clocks that the reader goes on
    reg done = 0;

    always @(posedge clk) if (rst) begin
        dice <= seed * 2 + 1;
    end else begin
        dice <= next(dice);
        if (i_valid && i_payload[9]) begin
            shown <= shown + 1;
            if (!good) begin
                faults <= faults + 32'(begun);
            end else begin
                whole <= whole + 1;
                if (skipped == skipped_before && skipped != 255) newest <= number;
            end
        end
        i_valid <= 0;
        info <= dice[31:15];
        if (pause != 0) begin
            pause <= pause - 1;
        end else if (number != frames[15:0] && dice[7:0] >= gap) begin
            i_valid <= 1;
            i_payload <= {3'b000, pixel(current, address)};
            i_payload[8] <= address % WIDTH == WIDTH - 1;
            if (address == 0) skipped_before <= skipped;
            if (address == 0) info <= {current[0] ^ current[4], current};
            address <= address + 1;
            if (address + 1 == length && !breaks) i_payload[9:8] <= 3;
            if (address == length) i_payload <= {3'b111, dice[15:8]};
            if (address + 1 >= length + 32'(breaks)) begin
                number <= current;
                good <= length == PIXELS && !breaks;
                begun <= length != 0;
                address <= 0;
                pause <= blanking == 0 ? 0 : {16'd0, dice[23:8]} % ({16'd0, blanking} + 1);
                breaks <= 0;
                length <= PIXELS;
                if (dice[31:24] < faulty) begin
                    breaks <= dice[20] || strange == 0;
                    length <= strange;
                end
            end
        end
    end

    // Reader. It holds a frame for `hold` clocks at most, reading in a random order or straight
    // on, and at times gives its bank back and waits.
    reg [15:0] hold = 100;
    reg reads_along = 0;
    reg [7:0] idling = 0;  // chance in 256 to want no frame
    reg acquire = 0;
    reg give_back = 0;
    reg [31:0] place = 0;
    reg [31:0] place_1 = 0;
    reg [31:0] place_2 = 0;
    reg [2:0] reading = 0;
    reg [1:0] state = 0;
    reg asked = 0;
    reg [31:0] left = 0;
    reg [31:0] waited = 0;
    reg [31:0] luck = 1;
    reg [15:0] least = 0;
    reg [15:0] mine = 0;
    reg seen = 0;

    reg [31:0] granted = 0;
    reg [31:0] fresh_ones = 0;
    reg [31:0] compared = 0;
    reg [31:0] torn = 0;
    reg [31:0] stale = 0;  // not the newest frame, or wrongly reported as fresh or not
    reg [31:0] changed = 0;  // what is known of the frame changed while it was held
    reg [31:0] longest = 0;  // clocks from a request to the answer

    always @(posedge display_clk) if (display_rst) begin
        luck <= seed * 2 + 77;
    end else begin
        luck <= next(luck);
        if (shown == frames) begin
            tail <= tail - 1;
            if (tail == 0) done <= 1;
        end
        acquire <= 0;
        give_back <= 0;
        reading <= {reading[1:0], 1'b0};
        place_1 <= place;
        place_2 <= place_1;
        case (state)
            0: if (idle) begin
                state <= 1;
                asked <= luck[15:8] >= idling;
                acquire <= luck[15:8] >= idling;
                give_back <= luck[15:8] < idling;
                least <= newest;
                waited <= 0;
                place <= luck % PIXELS;
                reading[0] <= held;
                left <= {16'd0, luck[31:16]} % ({16'd0, hold} + 1);
            end
            1: begin
                waited <= waited + 1;
                if (waited > 2 && held) begin
                    state <= 2;
                    granted <= granted + 1;
                    fresh_ones <= fresh_ones + 32'(fresh);
                    if (!asked || $signed(frame[15:0] - least) < 0
                        || $signed(number - frame[15:0]) < 0
                        || fresh != (!seen || frame[15:0] != mine)
                        || frame[16] != (frame[0] ^ frame[4]))
                        stale <= stale + 1;
                    mine <= frame[15:0];
                    seen <= 1;
                    if (waited > longest) longest <= waited;
                end else if (waited > 2 && idle) begin
                    state <= asked ? 0 : 3;
                end
            end
            2: begin
                if (left != 0) left <= left - 1;
                else if (idle) state <= 0;
                if (!held || frame[15:0] != mine) changed <= changed + 1;
                place <= reads_along ? (place + 1) % PIXELS : luck % PIXELS;
                reading[0] <= 1;
            end
            3: begin
                left <= left - 1;
                if (held) changed <= changed + 1;
                if (left == 0) state <= 0;
            end
        endcase
        if (reading[2]) begin
            compared <= compared + 1;
            if (data != pixel(mine, place_2)) torn <= torn + 1;
        end
    end

    frame_memory memory (
        .clk(clk), .rst(rst), .display_clk(display_clk), .display_rst(display_rst),
        .i_valid(i_valid), .i_payload(i_payload), .info(info),
        .broken(broken), .skipped(skipped), .unread(unread),
        .acquire(acquire), .give_back(give_back), .idle(idle), .held(held), .fresh(fresh),
        .frame(frame), .address(place[$clog2(PIXELS)-1:0]), .data(data)
    );

endmodule
