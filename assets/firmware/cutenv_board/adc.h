// Converter of the load cell: choose one. The rate is that of its own pins or registers, in readings a second.
#pragma once
#if !defined(ADC_HX711) && !defined(ADC_ADS1220) && !defined(ADC_NAU7802)
#define ADC_HX711
#endif
#ifndef ADC_RATE
#ifdef ADC_HX711
#define ADC_RATE 80  // pin RATE of the HX711 to its supply; to ground: 10
#elif defined(ADC_ADS1220)
#define ADC_RATE 330
#else
#define ADC_RATE 320
#endif
#endif

long extended(unsigned long raw) { return raw & 0x800000 ? (long)raw - 0x1000000L : (long)raw; }  // from 24 bits

#ifdef ADC_HX711
#define ADC_NAME "hx711"
const int DATA_PIN = 9, CLOCK_PIN = 10;

void adcBegin() { pinMode(CLOCK_PIN, OUTPUT), pinMode(DATA_PIN, INPUT), digitalWrite(CLOCK_PIN, LOW); }
bool adcReady() { return digitalRead(DATA_PIN) == LOW; }
long adcRead() {
  unsigned long raw = 0;
  for (int bit = 0; bit < 25; bit++) {  // 24 bits, and one clock more for channel A at gain 128
    digitalWrite(CLOCK_PIN, HIGH);
    delayMicroseconds(1);
    if (bit < 24) raw = raw << 1 | (digitalRead(DATA_PIN) == HIGH);
    digitalWrite(CLOCK_PIN, LOW);
    delayMicroseconds(1);
  }
  return extended(raw);
}
#elif defined(ADC_ADS1220)
#include <SPI.h>
#define ADC_NAME "ads1220"
const int READY_PIN = 9, SELECT_PIN = 10;

void adcSend(const uint8_t *bytes, int size) {
  digitalWrite(SELECT_PIN, LOW);
  while (size--) SPI.transfer(*bytes++);
  digitalWrite(SELECT_PIN, HIGH);
}
void adcBegin() {
  pinMode(READY_PIN, INPUT), pinMode(SELECT_PIN, OUTPUT), digitalWrite(SELECT_PIN, HIGH);
  SPI.begin();
  SPI.beginTransaction(SPISettings(1000000, MSBFIRST, SPI_MODE1));
  const uint8_t reset[] = {0x06};
  adcSend(reset, 1);
  delay(1);
  // AIN0-AIN1 at gain 128; 330 readings a second, continuously; the bridge's supply as the reference; no currents
  const uint8_t setup[] = {0x43, 0x0E, 0x84, 0x40, 0x00}, start[] = {0x08};
  adcSend(setup, 5);
  adcSend(start, 1);
}
bool adcReady() { return digitalRead(READY_PIN) == LOW; }
long adcRead() {
  unsigned long raw = 0;
  digitalWrite(SELECT_PIN, LOW);
  for (int i = 0; i < 3; i++) raw = raw << 8 | SPI.transfer(0);
  digitalWrite(SELECT_PIN, HIGH);
  return extended(raw);
}
#else
#include <Wire.h>
#define ADC_NAME "nau7802"
const int NAU7802 = 0x2A;

void adcPut(uint8_t address, uint8_t value) {
  Wire.beginTransmission(NAU7802), Wire.write(address), Wire.write(value), Wire.endTransmission();
}
uint8_t adcGet(uint8_t address) {
  Wire.beginTransmission(NAU7802), Wire.write(address), Wire.endTransmission(false);
  Wire.requestFrom(NAU7802, 1);
  return Wire.read();
}
void adcBegin() {
  Wire.begin();
  Wire.setClock(400000);
  adcPut(0x00, 0x01), delay(1);              // reset
  adcPut(0x00, 0x86), delay(1);              // digital and analogue parts on, inner supply of the bridge
  adcPut(0x01, 0x27), adcPut(0x02, 0x70);    // 3.3 V, gain 128; 320 readings a second
  adcPut(0x02, 0x74), delay(10);             // calibrate the offset
  adcPut(0x00, 0x96);                        // go
}
bool adcReady() {  // asked once in a millisecond: the two-wire bus is slow, and the steps go on
  static unsigned long asked = 0;
  if (micros() - asked < 1000) return false;
  asked = micros();
  return adcGet(0x00) & 0x20;
}
long adcRead() {
  unsigned long raw = 0;
  for (uint8_t address = 0x12; address < 0x15; address++) raw = raw << 8 | adcGet(address);
  return extended(raw);
}
#endif
