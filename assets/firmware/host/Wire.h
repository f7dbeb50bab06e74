// Stand-in for the bus of a NAU7802.
#pragma once
#include <stdint.h>
struct HostWire {
  void begin() {}
  void setClock(long) {}
  void beginTransmission(int address);
  void write(uint8_t byte);
  int endTransmission(bool stop = true);
  void requestFrom(int address, int count);
  int read();
};
extern HostWire Wire;
