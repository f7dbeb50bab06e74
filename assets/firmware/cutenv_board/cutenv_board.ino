// Board of a cutenv rig: a load cell, and a stepper by step and direction, for Arduino, Teensy and RP2040.
//
// Lines of text, each "TEXT*CRC" with the CRC-16 of the text (CCITT, from 0xFFFF) in four hexadecimal digits.
// To the board:  H  I  P [accel quick fastest low high]  N  X  V rate  Q  C  Z        (steps, steps/s, steps/s2)
// From it:       A name version adc rate | P ... | F sequence status counts | M sequence state flags steps rate bad
// Any valid command but P is a sign of life: what is no command, or an echo of our own lines, is not. Without one for 100 ms a powered stepper stops by itself, and stays stopped.
#include <Arduino.h>
#include "adc.h"  // choose HX711, ADS1220 or NAU7802 there

const int STEP_PIN = 3, DIR_PIN = 4, ENABLE_PIN = 5;  // the driver's; its enable line is active low
const int STOP_PIN = 6;                 // second contact of the stop button: closed to ground, open stops
const int LOW_PIN = 7, HIGH_PIN = 8;    // limit switches, closed to ground, open where the travel ends
const unsigned long PATIENCE = 100000;  // us without a line from the computer
const unsigned long REPORT = 10000;     // us between two reports of the motion
const long FASTEST = 20000;             // steps/s: more than loop() can make on a slow board is refused

enum State { OFF, ENABLED, STOPPED, FAULT };
enum Flag { ZEROED = 1, AT_LOW = 2, AT_HIGH = 4, STOP_OPEN = 8, SILENT = 16, SOFT_END = 32, UNSET = 64 };

State state = OFF;
unsigned flags = UNSET;                 // those of the pins are live, SILENT and SOFT_END stay until they are cleared
long steps = 0, rate = 0, target = 0, phase = 0;
long accel = 1000, quick = 1000, fastest = 0, lowEnd = 0, highEnd = 0;
unsigned long readings = 0, reports = 0, bad = 0;
unsigned long heard = 0, ramped = 0, stepped = 0, reported = 0;
char line[64];
unsigned length = 0;

unsigned crc16(const char *text, unsigned size) {
  unsigned long crc = 0xFFFF;
  for (unsigned i = 0; i < size; i++) {
    crc ^= (unsigned long)(unsigned char)text[i] << 8;
    for (int bit = 0; bit < 8; bit++) crc = crc & 0x8000 ? (crc << 1) ^ 0x1021 : crc << 1;
  }
  return crc & 0xFFFF;
}

void tell(const char *text) {  // whole or not at all: a full buffer must not hold up the steps
  char whole[72];
  int size = snprintf(whole, sizeof whole, "%s*%04X\n", text, crc16(text, strlen(text)));
  if (Serial.availableForWrite() >= size) Serial.write((const uint8_t *)whole, size);
}

void stop(unsigned why) {  // stays stopped until it is cleared
  flags |= why;
  if (state == ENABLED) state = STOPPED;
}

void obey(char *text) {
  char told[72];
  long a, q, f, l, h;
  bool known = !text[1] || text[0] == 'P' || text[0] == 'V';
  if (!known) {
    bad++;
    return;
  }
  switch (text[0]) {
    case 'H': break;
    case 'I': snprintf(told, sizeof told, "A cutenv-board 1 %s %d", ADC_NAME, ADC_RATE); tell(told); break;
    case 'P':
      if (state == OFF && sscanf(text + 1, "%ld %ld %ld %ld %ld", &a, &q, &f, &l, &h) == 5 && a >= 1000 && q >= a &&
          f > 0 && f <= FASTEST && l < h) {
        accel = a, quick = q, fastest = f, lowEnd = l, highEnd = h;
        flags &= ~UNSET;
      }
      snprintf(told, sizeof told, "P %ld %ld %ld %ld %ld", accel, quick, fastest, lowEnd, highEnd);
      tell(told);
      break;
    case 'N':
      if (state == OFF && !(flags & ~(ZEROED | AT_LOW | AT_HIGH)) && flags & ZEROED) {
        target = 0;
        state = ENABLED;
        digitalWrite(ENABLE_PIN, LOW);
      }
      break;
    case 'V':
      known = sscanf(text + 1, "%ld", &a) == 1;
      if (known && state == ENABLED) target = constrain(a, -fastest, fastest);
      break;
    case 'Q': stop(0); break;
    case 'X':
      if (state == ENABLED && rate) stop(0);
      if (!rate) {
        digitalWrite(ENABLE_PIN, HIGH);
        if (state == ENABLED) state = OFF;
      }
      break;
    case 'C':
      if (!rate && !(flags & STOP_OPEN)) {
        digitalWrite(ENABLE_PIN, HIGH);
        flags &= ~(SILENT | SOFT_END);
        state = OFF;
      }
      break;
    case 'Z':  // the blade stands at the clamp: a person has put it there
      if (state == OFF) steps = 0, flags |= ZEROED;
      break;
    default: known = false;
  }
  if (!known) bad++;
  else if (text[0] != 'P') heard = micros();  // a line with P may be our own, echoed
}

void listen() {
  while (Serial.available()) {
    char c = Serial.read();
    if (c != '\n') {
      if (length < sizeof line - 1) line[length++] = c;
      else length = 0, bad++;
      continue;
    }
    line[length] = 0;
    char *star = strrchr(line, '*');
    unsigned size = star ? star - line : 0;
    if (size && length == size + 5 && strtoul(star + 1, 0, 16) == crc16(line, size)) *star = 0, obey(line);
    else bad++;
    length = 0;
  }
}

void watch() {  // pins, ends of travel, the computer's silence
  bool low = digitalRead(LOW_PIN) == HIGH, high = digitalRead(HIGH_PIN) == HIGH, open = digitalRead(STOP_PIN) == HIGH;
  flags = (flags & ~(AT_LOW | AT_HIGH | STOP_OPEN)) | low * AT_LOW | high * AT_HIGH | open * STOP_OPEN;
  if (open && state != FAULT) {
    state = FAULT;
    if (!rate) digitalWrite(ENABLE_PIN, HIGH);
  }
  if (state != ENABLED) return;
  if ((low && rate < 0) || (high && rate > 0)) stop(0);
  if ((steps <= lowEnd && rate < 0) || (steps >= highEnd && rate > 0)) stop(SOFT_END);
  if (micros() - heard > PATIENCE) stop(SILENT);
}

void ramp() {  // once a millisecond: toward the target, or down to rest
  long change = (state == ENABLED ? target : 0) - rate, most = (state == ENABLED ? accel : quick) / 1000;
  long before = rate;
  rate += constrain(change, -most, most);
  if (before && !rate && state == FAULT) digitalWrite(ENABLE_PIN, HIGH);
}

void move(unsigned long passed) {
  phase += rate * (long)min(passed, 1000UL);
  while (phase >= 1000000 || phase <= -1000000) {
    int way = phase > 0 ? 1 : -1;
    digitalWrite(DIR_PIN, way > 0 ? HIGH : LOW);
    delayMicroseconds(1);
    digitalWrite(STEP_PIN, HIGH);
    delayMicroseconds(2);
    digitalWrite(STEP_PIN, LOW);
    steps += way;
    phase -= way * 1000000L;
  }
}

void report() {
  char told[72];
  snprintf(told, sizeof told, "M %lu %d %u %ld %ld %lu", reports++, (int)state, flags, steps, rate, bad);
  tell(told);
}

void weigh() {
  char told[48];
  long counts = adcRead();
  snprintf(told, sizeof told, "F %lu %d %ld", readings++, counts >= 8388607 || counts <= -8388608, counts);
  tell(told);
}

void setup() {
  pinMode(STEP_PIN, OUTPUT), pinMode(DIR_PIN, OUTPUT), pinMode(ENABLE_PIN, OUTPUT);
  digitalWrite(ENABLE_PIN, HIGH);
  pinMode(STOP_PIN, INPUT_PULLUP), pinMode(LOW_PIN, INPUT_PULLUP), pinMode(HIGH_PIN, INPUT_PULLUP);
  Serial.begin(500000);
  adcBegin();
}

void loop() {
  listen();
  watch();
  unsigned long now = micros();
  if (now - ramped >= 1000) ramped += now - ramped >= 2000 ? now - ramped : 1000, ramp();
  move(now - stepped);
  stepped = now;
  if (now - reported >= REPORT) reported = now, report();
  if (adcReady()) weigh();
}
