// The Verilated instrument as a plain C library: an imager at its sensor pins, a serial line at its
// UART pins. No VPI. The imager integrates as the pins tell it, and asks for the picture by callback.
// With PAPER defined it is of the preset paper, its memory beside it and its screen on. With
// CONVERTER_LATENCY the imager's pixels are addressed, and a converter takes so many clocks.
#include "Vinstrument.h"
#include "verilated.h"

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <deque>
#include <vector>

namespace {

// Fills in a frame of grey values: clocks of integration since the reset, of them lit.
using Picture = void (*)(uint64_t integrated, uint64_t lit, uint8_t* grey);

// An AC-coupled driver: lit while its pin moves, dark this many clocks after it stands still.
constexpr int HOLD = 4;

struct Sensor {
    size_t width, height, line_blanking;
    Picture picture;
    std::vector<uint8_t> grey;
    uint64_t integrated = 0, lit = 0;
    bool read_before = false, reading = false, silent = false;
    size_t row = 0, column = 0;
    size_t stop_row = SIZE_MAX;  // the frame ends early, at this row
    size_t short_row = SIZE_MAX;  // this row of the next frame ...
    int short_by = 0;  // ... lacks so many pixels, or has more

    void expose(bool reset, bool integrate, bool read, bool light) {
        if (reset) integrated = lit = 0;
        else if (integrate) ++integrated, lit += light;
        if (read && !read_before && !silent) {
            grey.resize(width * height);
            picture(integrated, lit, grey.data());
            reading = true;
            row = column = 0;
        }
        read_before = read;
    }

#ifdef CONVERTER_LATENCY
    uint8_t converted[CONVERTER_LATENCY + 1] = {};

    // A clock of the converter: between results, and where there is no picture, there is anything.
    void convert(Vinstrument& top) {
        std::memmove(converted + 1, converted, CONVERTER_LATENCY);
        size_t place = top.row * width + top.column;
        converted[0] = top.convert && reading ? grey[place]
                                              : static_cast<uint8_t>(7 * converted[0] + 91);
        if (top.convert && place == width * height - 1) reading = false;
        top.data = converted[CONVERTER_LATENCY];
    }
#else
    // One pixel clock of the read-out.
    void pixel(Vinstrument& top) {
        top.frame_valid = reading;
        size_t length = width - (row == short_row ? short_by : 0);
        top.line_valid = reading && column < length;
        if (!reading) return;
        if (column < length) top.data = grey[row * width + (column < width ? column : width - 1)];
        if (++column == length + line_blanking) {
            column = 0;
            if (++row == (stop_row < height ? stop_row : height)) {
                reading = false;
                stop_row = short_row = SIZE_MAX;
            }
        }
    }
#endif
};

struct Instrument {
    VerilatedContext context;
    Vinstrument top{&context, "TOP"};
    Sensor sensor;
    uint64_t clocks = 0;
    uint64_t pixel_hz, clock_hz, phase = 0;
    uint32_t divisor;

    // Serial line to the host.
    std::vector<uint8_t> received;
    std::vector<uint64_t> stamps;  // clock of each octet's start bit
    int bit = -1;
    uint32_t left = 0;
    uint8_t character = 0;
    uint64_t framing_errors = 0;

    // Serial line from the host.
    std::deque<uint8_t> queue;
    uint32_t out = 0, out_bits = 0, out_left = 0;

    // Laser driver: (first lit clock, first dark clock) of every pulse.
    bool pin = false;
    int hold = 0;
    bool light = false;
    std::vector<uint64_t> pulses;

    Instrument(Sensor s, uint64_t pixel, uint64_t clock, uint32_t divisor)
        : sensor(std::move(s)), pixel_hz(pixel), clock_hz(clock), divisor(divisor) {
        top.rx = 1;
        top.cts = 1;
    }

#ifdef PAPER
    StaticRAM ram;
    uint64_t screen = 0;
#endif

    void clock() {
        phase += pixel_hz;
        bool pixel = phase >= clock_hz;
        if (pixel) phase -= clock_hz;
#ifdef PAPER
        top.clk = top.spot_clk = 0;
#ifndef CONVERTER_LATENCY
        top.pixel_clk = 0;
#endif
        top.eval();
        ram.look(top);
        top.clk = 1;
#ifndef CONVERTER_LATENCY
        top.pixel_clk = pixel;
#endif
        top.spot_clk = top.busy;
        top.eval();
        ram.look(top);
        for (screen += 25175000; screen >= clock_hz; screen -= clock_hz) {
            top.display_clk ^= 1;  // every change is a rising edge, see library.py
            top.eval();
        }
#else
        // Every change of a clock is a rising edge here, see library.py.
        top.clk ^= 1;
#ifndef CONVERTER_LATENCY
        if (pixel) top.pixel_clk ^= 1;
#endif
        top.spot_clk ^= top.busy;
        top.eval();
#endif
        ++clocks;

        hold = top.laser != pin ? HOLD : hold ? hold - 1 : 0;
        pin = top.laser;
        if ((hold > 0) != light) light = hold > 0, pulses.push_back(clocks);
        sensor.expose(top.sensor_reset, top.sensor_integrate, top.sensor_read, light);
#ifdef CONVERTER_LATENCY
        sensor.convert(top);
#else
        if (pixel) sensor.pixel(top);
#endif
        listen();
        speak();
    }

    void listen() {
        if (bit < 0) {
            if (!top.tx) bit = 0, left = divisor + divisor / 2 - 1, stamps.push_back(clocks);
        } else if (left) {
            --left;
        } else if (bit < 8) {
            character = static_cast<uint8_t>(character >> 1 | top.tx << 7);
            ++bit;
            left = divisor - 1;
        } else {
            if (!top.tx) ++framing_errors;
            received.push_back(character);
            bit = -1;
        }
    }

    void speak() {
        if (out_left) {
            --out_left;
            return;
        }
        if (!out_bits) {
            if (queue.empty()) return;
            out = queue.front() << 1 | 0x200;
            queue.pop_front();
            out_bits = 10;
        }
        top.rx = out & 1;
        out >>= 1;
        --out_bits;
        out_left = divisor - 1;
    }
};

}  // namespace

extern "C" {

Instrument* instrument_new(size_t width, size_t height, size_t line_blanking, uint64_t pixel_hz,
                           uint64_t clock_hz, uint32_t divisor, Picture picture) {
    return new Instrument(Sensor{width, height, line_blanking, picture}, pixel_hz, clock_hz, divisor);
}

void instrument_free(Instrument* instrument) {
    instrument->top.final();
    delete instrument;
}

uint64_t instrument_clocks(const Instrument* instrument) { return instrument->clocks; }

void instrument_run(Instrument* instrument, uint64_t clocks) {
    while (clocks--) instrument->clock();
}

void instrument_send(Instrument* instrument, const uint8_t* octets, size_t count) {
    instrument->queue.insert(instrument->queue.end(), octets, octets + count);
}

size_t instrument_unsent(const Instrument* instrument) { return instrument->queue.size(); }

// Takes octets that have come from the chip, and the clock of each one's start bit.
size_t instrument_receive(Instrument* instrument, uint8_t* out, uint64_t* stamps, size_t room) {
    auto& received = instrument->received;
    auto& times = instrument->stamps;
    size_t count = received.size() < room ? received.size() : room;
    std::memcpy(out, received.data(), count);
    std::memcpy(stamps, times.data(), count * sizeof *stamps);
    received.erase(received.begin(), received.begin() + count);
    times.erase(times.begin(), times.begin() + count);
    return count;
}

uint64_t instrument_framing_errors(const Instrument* instrument) {
    return instrument->framing_errors;
}

// Clocks at which the laser became lit, dark, lit, ...
size_t instrument_pulses(const Instrument* instrument, uint64_t* out, size_t room) {
    auto& pulses = instrument->pulses;
    size_t count = pulses.size() < room ? pulses.size() : room;
    std::memcpy(out, pulses.data(), count * sizeof *out);
    return pulses.size();
}

void instrument_cts(Instrument* instrument, int may_send) { instrument->top.cts = may_send; }

#ifdef PAPER
void instrument_fill_memory(Instrument* instrument, uint32_t address, const uint32_t* word,
                            size_t count) {
    std::memcpy(&instrument->ram.words[address], word, count * sizeof *word);
}
#endif

// Faults of the sensor: it sends nothing; its next frame ends early; a row of it has another length.
// The latter two are of one that sends frames by itself.
void instrument_silence(Instrument* instrument, int silent) { instrument->sensor.silent = silent; }
void instrument_stop_row(Instrument* instrument, size_t row) { instrument->sensor.stop_row = row; }
void instrument_short_row(Instrument* instrument, size_t row, int by) {
    instrument->sensor.short_row = row;
    instrument->sensor.short_by = by;
}

}  // extern "C"
