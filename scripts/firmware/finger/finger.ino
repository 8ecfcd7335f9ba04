/* The soft finger of configs/finger.toml: twelve electrodes and six pressure sensors, 100 Hz. What pulls the cable
 * reports cable0_mm by itself.
 *
 * Wiring of an Arduino Nano (ATmega328P, 5 V), whose A4 and A5 are the I2C bus:
 *   MPR121 breakout with level shifter, address 0x5A: electrodes 0 to 11 are electrode0 ... electrode11
 *   NXP MPX5100AP, supplied by the 5 V that the converter refers to: outputs of the cavities base left, base right,
 *   middle left, middle right, tip left, tip right to A0, A1, A2, A3, A6, A7
 *
 * Needs ../softfuse_wire.h and ../softfuse_mpr121.h:
 *   arduino-cli compile --fqbn arduino:avr:nano --library scripts/firmware scripts/firmware/finger
 * or, in the Arduino IDE, copy both next to this file.
 */
#include <Wire.h>

#include "softfuse_mpr121.h"
#include "softfuse_wire.h"

const uint32_t kBaud = 500000;  // a description takes 8 ms then; divides 16 MHz without error
const uint32_t kPeriodUs = 10000;
const uint32_t kDescribeUs = 1000000;
const uint8_t kElectrodes = 12;
const uint8_t kPressures = 6;
const uint8_t kPressurePins[kPressures] = {A0, A1, A2, A3, A6, A7};
const uint8_t kReadings = 8;  // of each pin, added up; 0.1 ms each
const float kVoltsPerCount = 5.0f / (1024.0f * kReadings);

#define ELECTRODE(name) {SOFTFUSE_U16, softfuse::kMpr121Scale, softfuse::kMpr121Offset, name}
#define PRESSURE(name) {SOFTFUSE_U16, kVoltsPerCount, 0.0f, name}
const softfuse_channel kChannels[] = {
    ELECTRODE("electrode0"),  ELECTRODE("electrode1"),  ELECTRODE("electrode2"),  ELECTRODE("electrode3"),
    ELECTRODE("electrode4"),  ELECTRODE("electrode5"),  ELECTRODE("electrode6"),  ELECTRODE("electrode7"),
    ELECTRODE("electrode8"),  ELECTRODE("electrode9"),  ELECTRODE("electrode10"), ELECTRODE("electrode11"),
    PRESSURE("pressure0_V"),  PRESSURE("pressure1_V"),  PRESSURE("pressure2_V"),  PRESSURE("pressure3_V"),
    PRESSURE("pressure4_V"),  PRESSURE("pressure5_V"),
};
const uint16_t kCount = sizeof kChannels / sizeof kChannels[0];

softfuse_device device = softfuse_device_of(2, "Soft Finger", kChannels, kCount);
softfuse_clock extended;
softfuse_question question;
uint8_t packet[SOFTFUSE_DESCRIPTION_SIZE(kCount, 11 + 10 * 10 + 2 * 11 + 6 * 11)];
uint32_t sequence = 0;

softfuse::Mpr121 electrodes(0x5A, kElectrodes);
bool silence_told = false;
uint32_t sampled_us, described_us;

uint64_t now() { return softfuse_extend(&extended, micros()); }

void send(size_t bytes) { Serial.write(packet, bytes); }

void remark(const char *text) {
  send(softfuse_remark(packet, sizeof packet, &device, sequence, now(), text));
}

void describe() {
  described_us = micros();
  send(softfuse_describe(packet, sizeof packet, &device, sequence, now()));
}

/* Starts the electrodes' chip where it does not answer, and tells the host when that changes. */
void startElectrodes() {
  const bool silence = !(electrodes.ready() || electrodes.begin());
  if (silence != silence_told) {
    remark(silence ? "the electrodes' chip does not answer: check its wiring" : "the electrodes' chip answers");
  }
  silence_told = silence;
}

void putElectrodes(softfuse_sample *sample) {
  uint16_t raw[kElectrodes];
  const bool read = electrodes.read(raw);
  for (uint8_t k = 0; k < kElectrodes; ++k) {
    if (read) {
      softfuse_put_u16(sample, raw[k]);
    } else {
      softfuse_put_missing(sample);
    }
  }
}

void sendSample() {
  softfuse_sample sample;
  softfuse_sample_begin(&sample, packet, sizeof packet, &device, sequence, now());
  putElectrodes(&sample);
  for (uint8_t k = 0; k < kPressures; ++k) {
    uint16_t sum = 0;
    for (uint8_t i = 0; i < kReadings; ++i) {
      sum = static_cast<uint16_t>(sum + analogRead(kPressurePins[k]));
    }
    softfuse_put_u16(&sample, sum);
  }
  send(softfuse_sample_end(&sample));
  ++sequence;
}

void setup() {
  Serial.begin(kBaud);
  Serial.write(static_cast<uint8_t>(0));  // ends what the bootloader may have printed
  Wire.begin();
  Wire.setClock(400000);
#ifdef WIRE_HAS_TIMEOUT
  Wire.setWireTimeout(3000, true);  // else a stuck bus would stop everything
#endif
  describe();
  startElectrodes();
  sampled_us = micros();
}

void loop() {
  while (Serial.available() > 0) {
    if (softfuse_asked(&question, &device, static_cast<uint8_t>(Serial.read()))) {
      describe();
    }
  }
  const uint32_t late = micros() - sampled_us;
  if (late >= kPeriodUs) {
    // After a delay of more than a period the missed samples are left out, not sent in a burst.
    sampled_us += late - late % kPeriodUs;
    sendSample();
  }
  if (micros() - described_us >= kDescribeUs) {
    describe();
    startElectrodes();
  }
}
