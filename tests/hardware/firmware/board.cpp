/* A board for the sketches: SECONDS START_US SILENT_FROM_S SILENT_TO_S HEX_FROM_HOST.
 *
 * Runs the sketch for so many seconds of its own time, whose counter begins at START_US. Between the two other times
 * the chips on the I2C bus do not answer. The bytes from the host come after half a second.
 */
#include <stdio.h>
#include <stdlib.h>

#include <string>

#include "Arduino.h"
#include "Wire.h"

SerialPort Serial;
TwoWire Wire;

namespace {
uint64_t passed_us = 0;
uint64_t start_us = 0;
double silent_from_s = 0.0, silent_to_s = 0.0, byte_us = 1e9;
std::string from_host;
size_t taken = 0;
uint8_t registers[2][256] = {};

bool chip_answers(uint8_t address) {
  const double now_s = 1e-6 * static_cast<double>(passed_us);
  return (address == 0x5A || address == 0x5B) && !(silent_from_s <= now_s && now_s < silent_to_s);
}

void pass_bytes(size_t size, double each_us) { passed_us += static_cast<uint64_t>(each_us * static_cast<double>(size)); }
}  // namespace

uint32_t micros() { return static_cast<uint32_t>(start_us + ++passed_us); }

int analogRead(uint8_t pin) {
  passed_us += 112;
  return 100 + 50 * (pin - A0);
}

void SerialPort::begin(unsigned long baud) { byte_us = 1e7 / static_cast<double>(baud); }

int SerialPort::available() {
  return passed_us < 500000 ? 0 : static_cast<int>(from_host.size() - taken);
}

int SerialPort::read() { return available() > 0 ? static_cast<uint8_t>(from_host[taken++]) : -1; }

size_t SerialPort::write(uint8_t byte) { return write(&byte, 1); }

size_t SerialPort::write(const uint8_t *bytes, size_t size) {
  pass_bytes(size, byte_us);
  return fwrite(bytes, 1, size, stdout);
}

void TwoWire::begin() { begun_ = true; }

void TwoWire::setClock(uint32_t) {}

void TwoWire::beginTransmission(uint8_t address) {
  address_ = address;
  used_ = 0;
}

size_t TwoWire::write(uint8_t byte) {
  if (used_ == sizeof sent_) return 0;
  sent_[used_++] = byte;
  return 1;
}

uint8_t TwoWire::endTransmission(bool) {
  pass_bytes(1u + used_, 25.0);
  if (!begun_ || !chip_answers(address_)) return 2;
  if (used_ > 0) next_ = sent_[0];
  if (used_ > 1) registers[address_ - 0x5A][next_] = sent_[1];
  return 0;
}

uint8_t TwoWire::requestFrom(uint8_t address, uint8_t size) {
  pass_bytes(1u + size, 25.0);
  left_ = chip_answers(address) && size <= 32 ? size : 0;
  address_ = address;
  return left_;
}

int TwoWire::read() {
  if (left_ == 0) return -1;
  --left_;
  const uint8_t at = next_++;
  const uint8_t *own = registers[address_ - 0x5A];
  const uint8_t electrode = static_cast<uint8_t>((at - 0x04) / 2);
  // Only a chip that runs has readings, and only of the electrodes that it was told to scan.
  if (at < 0x04 || electrode >= (own[0x5E] & 0x0F)) return 0;
  const int raw = 700 - 10 * electrode - 200 * (address_ - 0x5A);
  return (at & 1) ? raw >> 8 : raw & 0xFF;
}

int main(int count, char **arguments) {
  if (count != 6) return 1;
  const double seconds = atof(arguments[1]);
  start_us = strtoull(arguments[2], nullptr, 10);
  silent_from_s = atof(arguments[3]);
  silent_to_s = atof(arguments[4]);
  const std::string hex = arguments[5];
  for (size_t k = 0; k + 1 < hex.size(); k += 2) {
    from_host += static_cast<char>(strtoul(hex.substr(k, 2).c_str(), nullptr, 16));
  }
  setup();
  while (1e-6 * static_cast<double>(passed_us) < seconds) {
    loop();
    passed_us += 20;
  }
  return 0;
}
