/* The soft pad of configs/pad.toml: two capacitive modules of 8 electrodes and four flow sensors, 100 Hz.
 *
 * Wiring of an Arduino Nano (ATmega328P, 5 V):
 *   MPR121 breakout with level shifter, address 0x5A (ADDR to GND): electrodes 0 to 7 are row0 ... row7
 *   MPR121 breakout with level shifter, address 0x5B (ADDR to VCC): electrodes 0 to 7 are col0 ... col7
 *   OMRON D6F-P0001A1: outputs of the cavities (-,-), (-,+), (+,-), (+,+) to A0, A1, A2, A3
 *
 * Needs ../softfuse_wire.h and ../softfuse_mpr121.h:
 *   arduino-cli compile --fqbn arduino:avr:nano --library scripts/firmware scripts/firmware/pad
 * or, in the Arduino IDE, copy both next to this file.
 */
#include <Wire.h>

#include "softfuse_mpr121.h"
#include "softfuse_wire.h"

const uint32_t kBaud = 500000;  // a description takes 8 ms then; divides 16 MHz without error
const uint32_t kPeriodUs = 10000;
const uint32_t kDescribeUs = 1000000;
const uint8_t kElectrodes = 8;
const uint8_t kFlows = 4;
const uint8_t kFlowPins[kFlows] = {A0, A1, A2, A3};
const uint8_t kReadings = 8;  // of each pin, added up; 0.1 ms each
const float kVoltsPerCount = 5.0f / (1024.0f * kReadings);

#define ELECTRODE(name) {SOFTFUSE_U16, softfuse::kMpr121Scale, softfuse::kMpr121Offset, name}
#define FLOW(name) {SOFTFUSE_U16, kVoltsPerCount, 0.0f, name}
const softfuse_channel kChannels[] = {
    ELECTRODE("row0"), ELECTRODE("row1"), ELECTRODE("row2"), ELECTRODE("row3"),
    ELECTRODE("row4"), ELECTRODE("row5"), ELECTRODE("row6"), ELECTRODE("row7"),
    ELECTRODE("col0"), ELECTRODE("col1"), ELECTRODE("col2"), ELECTRODE("col3"),
    ELECTRODE("col4"), ELECTRODE("col5"), ELECTRODE("col6"), ELECTRODE("col7"),
    FLOW("flow0_V"),   FLOW("flow1_V"),   FLOW("flow2_V"),   FLOW("flow3_V"),
};
const uint16_t kCount = sizeof kChannels / sizeof kChannels[0];

softfuse_device device = softfuse_device_of(1, "Soft Pad", kChannels, kCount);
softfuse_clock extended;
softfuse_question question;
uint8_t packet[SOFTFUSE_DESCRIPTION_SIZE(kCount, 8 + 16 * 4 + 4 * 7)];
uint32_t sequence = 0;

softfuse::Mpr121 rows(0x5A, kElectrodes);
softfuse::Mpr121 columns(0x5B, kElectrodes);
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

/* Starts the modules that do not answer, and tells the host when that changes. */
void startModules() {
  const bool rows_answer = rows.ready() || rows.begin();
  const bool columns_answer = columns.ready() || columns.begin();
  const bool silence = !(rows_answer && columns_answer);
  if (silence != silence_told) {
    remark(silence ? "a capacitive module does not answer: check its wiring" : "all capacitive modules answer");
  }
  silence_told = silence;
}

void putElectrodes(softfuse_sample *sample, softfuse::Mpr121 *module) {
  uint16_t raw[kElectrodes];
  const bool read = module->read(raw);
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
  putElectrodes(&sample, &rows);
  putElectrodes(&sample, &columns);
  for (uint8_t k = 0; k < kFlows; ++k) {
    uint16_t sum = 0;
    for (uint8_t i = 0; i < kReadings; ++i) {
      sum = static_cast<uint16_t>(sum + analogRead(kFlowPins[k]));
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
  startModules();
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
    startModules();
  }
}
