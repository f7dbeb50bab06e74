// Stand-in for the hardware: what the sketch needs of an Arduino, on this computer, with a time that is moved by hand.
#pragma once
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
enum { LOW, HIGH };
enum { INPUT, OUTPUT, INPUT_PULLUP };
#define min(a, b) ((a) < (b) ? (a) : (b))
#define constrain(x, low, high) ((x) < (low) ? (low) : (x) > (high) ? (high) : (x))
void pinMode(int pin, int mode);
void digitalWrite(int pin, int level);
int digitalRead(int pin);
unsigned long micros();
void delay(unsigned long milliseconds);
void delayMicroseconds(unsigned microseconds);
struct HostSerial {
  void begin(long baud);
  int available();
  int read();
  int availableForWrite();
  size_t write(const uint8_t *bytes, size_t size);
};
extern HostSerial Serial;
