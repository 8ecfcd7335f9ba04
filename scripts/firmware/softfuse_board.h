/* softfuse_board.h: what every sketch does: describe the device, answer questions, take samples in time.
 *
 * A sketch gives its device, a buffer for packets, and two functions: one puts the channels of a sample, the other
 * starts the chips that do not answer.
 */
#ifndef SOFTFUSE_BOARD_H
#define SOFTFUSE_BOARD_H

#include <Arduino.h>
#include <Wire.h>

#include "softfuse_mpr121.h"
#include "softfuse_wire.h"

namespace softfuse {

const uint32_t kBaud = 500000;  // a description takes 8 ms then; divides 16 MHz without error
const uint32_t kPeriodUs = 10000;
const uint32_t kDescribeUs = 1000000;
const uint8_t kReadings = 8;  // of each analogue pin, added up; 0.1 ms each
const float kVoltsPerCount = 5.0f / (1024.0f * kReadings);

/* Puts all electrodes of a chip, missing where it does not answer. */
template <uint8_t kElectrodes>
void putElectrodes(softfuse_sample *sample, Mpr121 *chip) {
  uint16_t raw[kElectrodes];
  const bool read = chip->read(raw);
  for (uint8_t k = 0; k < kElectrodes; ++k) {
    if (read) {
      softfuse_put_u16(sample, raw[k]);
    } else {
      softfuse_put_missing(sample);
    }
  }
}

/* Puts analogue pins, each the sum of kReadings. */
template <uint8_t kPins>
void putPins(softfuse_sample *sample, const uint8_t (&pins)[kPins]) {
  for (uint8_t k = 0; k < kPins; ++k) {
    uint16_t sum = 0;
    for (uint8_t i = 0; i < kReadings; ++i) {
      sum = static_cast<uint16_t>(sum + analogRead(pins[k]));
    }
    softfuse_put_u16(sample, sum);
  }
}

class Board {
 public:
  Board(softfuse_device *device, uint8_t *packet, size_t size) : device_(device), packet_(packet), size_(size) {}

  /* For setup(): begins to speak, describes the device, starts its chips. */
  void begin(void (*startChips)()) {
    Serial.begin(kBaud);
    Serial.write(static_cast<uint8_t>(0));  // ends what the bootloader may have printed
    Wire.begin();
    Wire.setClock(400000);
#ifdef WIRE_HAS_TIMEOUT
    Wire.setWireTimeout(3000, true);  // else a stuck bus would stop everything
#endif
    describe();
    startChips();
    sampled_us_ = micros();
  }

  /* For loop(): answers, samples when it is time, and now and then describes the device and starts its chips. */
  void run(void (*putChannels)(softfuse_sample *), void (*startChips)()) {
    while (Serial.available() > 0) {
      if (softfuse_asked(&question_, device_, static_cast<uint8_t>(Serial.read()))) {
        describe();
      }
    }
    const uint32_t late = micros() - sampled_us_;
    if (late >= kPeriodUs) {
      // After a delay of more than a period the missed samples are left out, not sent in a burst.
      sampled_us_ += late - late % kPeriodUs;
      sample(putChannels);
    }
    if (micros() - described_us_ >= kDescribeUs) {
      describe();
      startChips();
    }
  }

  /* Tells the host whether chips are silent, when that changes. */
  void tellSilence(bool silent, const char *begins, const char *ends) {
    if (silent != silence_told_) {
      send(softfuse_remark(packet_, size_, device_, sequence_, now(), silent ? begins : ends));
    }
    silence_told_ = silent;
  }

 private:
  uint64_t now() { return softfuse_extend(&extended_, micros()); }

  void send(size_t bytes) { Serial.write(packet_, bytes); }

  void describe() {
    described_us_ = micros();
    send(softfuse_describe(packet_, size_, device_, sequence_, now()));
  }

  void sample(void (*putChannels)(softfuse_sample *)) {
    softfuse_sample sample;
    softfuse_sample_begin(&sample, packet_, size_, device_, sequence_, now());
    putChannels(&sample);
    send(softfuse_sample_end(&sample));
    ++sequence_;
  }

  softfuse_device *device_;
  uint8_t *packet_;
  size_t size_;
  softfuse_clock extended_ = {};
  softfuse_question question_ = {};
  uint32_t sequence_ = 0;
  uint32_t sampled_us_ = 0;
  uint32_t described_us_ = 0;
  bool silence_told_ = false;
};

}  // namespace softfuse

#endif
