// Stand-in for the bus of an ADS1220.
#pragma once
#include <stdint.h>
enum { MSBFIRST = 1, SPI_MODE1 = 1 };
struct SPISettings { SPISettings(long, int, int) {} };
struct HostSpi {
  void begin() {}
  void beginTransaction(SPISettings) {}
  uint8_t transfer(uint8_t byte);
};
extern HostSpi SPI;
