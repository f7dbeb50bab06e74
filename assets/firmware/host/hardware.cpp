// Stand-in for the hardware around the sketch: pins, stepper driver, converter, serial line. Called by cutenv's emulator.
#include <deque>  // before the Arduino's macro "min"

#include "Arduino.h"
#include "SPI.h"
#include "Wire.h"

void setup();
void loop();
HostSerial Serial;
HostSpi SPI;
HostWire Wire;

namespace {
const int STEP = 3, DIRECTION = 4, ENABLE = 5, DATA = 9, PINS = 32;  // as in the sketch
#ifdef ADC_HX711
const int CLOCK = 10;
#endif
int levels[PINS] = {0, 0, 0, 0, 0, HIGH};  // the enable line is pulled up
unsigned long now = 0;         // us
long position = 0;             // steps that the motor has made
bool blocked = false;          // fault: the motor does not follow its pulses
std::deque<uint8_t> in, out;   // of the serial line: still to be read by the sketch, still to be sent
std::deque<char> sent;
long baud = 9600;
double credit = 0.0;           // bytes that the line could have sent
bool started = false;

long weight = 0;               // counts that the next conversion takes
unsigned long period = 12500;  // us between conversions
unsigned long due = 12500;
bool silent = false;
bool ready = false;
uint32_t shifted = 0;          // of the conversion that is being read
int bits = 0;                  // of it that an HX711 has shifted out; clocked: that an ADS1220 has
int clocked = 0;
uint8_t registers[32];         // of a NAU7802
int address = -1;

void convert() {
  if (silent || now < due) return;
  while (due <= now) due += period;
  if (bits == 0 || bits >= 24) shifted = (uint32_t)weight & 0xFFFFFF, ready = true, bits = clocked = 0;
}
void advance(unsigned long passed) {
  now += passed;
  credit += passed * baud / 1e7;
  while (credit >= 1.0 && !out.empty()) sent.push_back(out.front()), out.pop_front(), credit -= 1.0;
  if (out.empty()) credit = 0.0;
  convert();
}
}  // namespace

void pinMode(int, int) {}  // inputs are wired: closed to ground until board_set_pin() opens them
void digitalWrite(int pin, int level) {
  if (pin == STEP && level && !levels[STEP] && !levels[ENABLE] && !blocked) position += levels[DIRECTION] ? 1 : -1;
#ifdef ADC_HX711
  if (pin == CLOCK && level && !levels[CLOCK] && bits < 25) {
    bits++;
    if (bits == 25) ready = false;
  }
#endif
  levels[pin] = level;
}
int digitalRead(int pin) {
  if (pin != DATA) return levels[pin];
  if (bits == 0 || bits > 24) return ready ? LOW : HIGH;
  return shifted >> (24 - bits) & 1;
}
unsigned long micros() { return now; }
void delay(unsigned long milliseconds) { advance(1000 * milliseconds); }
void delayMicroseconds(unsigned microseconds) { advance(microseconds); }

void HostSerial::begin(long given) { baud = given; }
int HostSerial::available() { return in.size(); }
int HostSerial::read() {
  if (in.empty()) return -1;
  int byte = in.front();
  in.pop_front();
  return byte;
}
int HostSerial::availableForWrite() { return 64 - (int)min(out.size(), (size_t)64); }
size_t HostSerial::write(const uint8_t *bytes, size_t size) {
  out.insert(out.end(), bytes, bytes + size);
  return size;
}
uint8_t HostSpi::transfer(uint8_t) {
  if (!ready) return 0;
  clocked += 8;
  uint8_t told = shifted >> (24 - clocked) & 0xFF;
  if (clocked == 24) ready = false;
  return told;
}
void HostWire::beginTransmission(int) { address = -1; }
void HostWire::write(uint8_t byte) {
  if (address < 0) address = byte & 31;
  else registers[address] = byte;
}
int HostWire::endTransmission(bool) { return 0; }
void HostWire::requestFrom(int, int) {}
int HostWire::read() {
  if (address == 0) return (registers[0] & ~0x20) | (ready ? 0x20 : 0);
  if (address < 0x12 || address > 0x14) return registers[address];
  uint8_t told = shifted >> 8 * (0x14 - address) & 0xFF;
  if (address == 0x14) ready = false;
  return told;
}

extern "C" {
void board_advance(unsigned long microseconds, unsigned long loop_time) {
  if (!started) started = true, setup();
  for (unsigned long ends = now + microseconds; now < ends;) {
    advance(min(loop_time, ends - now));
    loop();
  }
}
void board_feed(const char *bytes, int size) { in.insert(in.end(), bytes, bytes + size); }
int board_drain(char *bytes, int most) {
  int size = 0;
  while (size < most && !sent.empty()) bytes[size++] = sent.front(), sent.pop_front();
  return size;
}
void board_converter(unsigned long given, int quiet) { period = given, silent = quiet; }
void board_weigh(long counts) { weight = counts; }
void board_set_pin(int pin, int level) { levels[pin] = level; }
int board_pin(int pin) { return levels[pin]; }
void board_block(int stands) { blocked = stands; }
long board_steps() { return position; }
}
