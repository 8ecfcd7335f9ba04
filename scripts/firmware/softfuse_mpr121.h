/* softfuse_mpr121.h: raw readings of an NXP MPR121, 12 electrodes on I2C (data sheet and AN3889, AN4600).
 *
 * Readings are 10 bit and fall when something grounded comes near. The chip's own touch detection is not used.
 */
#ifndef SOFTFUSE_MPR121_H
#define SOFTFUSE_MPR121_H

#include <Arduino.h>
#include <Wire.h>

namespace softfuse {

/* Counts that rise with touch, on the scale of 16 bit converters, from a reading: 65535 - 64 * reading. */
const float kMpr121Scale = -64.0f;
const float kMpr121Offset = 65535.0f;

class Mpr121 {
 public:
  Mpr121(uint8_t address, uint8_t electrodes) : address_(address), electrodes_(electrodes) {}

  /* Resets the chip and starts it; whether it answers. */
  bool begin() {
    ready_ = write(0x80, 0x63) &&                                // soft reset
             write(0x5E, 0x00) &&                                // stop, to configure
             write(0x5C, 0x10) &&                                // first filter 6 samples, charge 16 uA
             write(0x5D, 0x20) &&                                // charge 0.5 us, 4 samples 1 ms apart: 4 ms
             write(0x7D, 202) && write(0x7E, 131) && write(0x7F, 182) &&  // limits and target at 3.3 V
             write(0x7B, 0x09) &&                                // finds charge current and time, once
             write(0x5E, static_cast<uint8_t>(0x40 | electrodes_));  // run, without a baseline of its own
    return ready_;
  }

  /* Whether it has been started and has answered ever since. */
  bool ready() const { return ready_; }

  /* Reads all electrodes; whether the chip answered. */
  bool read(uint16_t *raw) {
    const uint8_t bytes = static_cast<uint8_t>(2 * electrodes_);
    if (ready_) {
      Wire.beginTransmission(address_);
      Wire.write(static_cast<uint8_t>(0x04));
      ready_ = Wire.endTransmission(false) == 0 && Wire.requestFrom(address_, bytes) == bytes;
    }
    for (uint8_t k = 0; ready_ && k < electrodes_; ++k) {
      const uint8_t low = static_cast<uint8_t>(Wire.read());
      const uint8_t high = static_cast<uint8_t>(Wire.read());
      raw[k] = static_cast<uint16_t>(low | ((high & 0x03) << 8));
    }
    return ready_;
  }

 private:
  bool write(uint8_t reg, uint8_t value) {
    Wire.beginTransmission(address_);
    Wire.write(reg);
    Wire.write(value);
    return Wire.endTransmission() == 0;
  }

  uint8_t address_;
  uint8_t electrodes_;
  bool ready_ = false;
};

}  // namespace softfuse

#endif
