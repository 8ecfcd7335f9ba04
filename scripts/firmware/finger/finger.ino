/* The soft finger of configs/finger.toml: twelve electrodes and six pressure sensors, 100 Hz. What pulls the cable
 * reports cable0_mm by itself.
 *
 * Wiring of an Arduino Nano (ATmega328P, 5 V), whose A4 and A5 are the I2C bus:
 *   MPR121 breakout with level shifter, address 0x5A: electrodes 0 to 11 are electrode0 ... electrode11
 *   NXP MPX5100AP, supplied by the 5 V that the converter refers to: outputs of the cavities base left, base right,
 *   middle left, middle right, tip left, tip right to A0, A1, A2, A3, A6, A7
 *
 * Needs ../softfuse_board.h, ../softfuse_wire.h and ../softfuse_mpr121.h:
 *   arduino-cli compile --fqbn arduino:avr:nano --library scripts/firmware scripts/firmware/finger
 * or, in the Arduino IDE, copy all three next to this file.
 */
#include "softfuse_board.h"

const uint8_t kElectrodes = 12;
const uint8_t kPressures = 6;
const uint8_t kPressurePins[kPressures] = {A0, A1, A2, A3, A6, A7};

#define ELECTRODE(name) {SOFTFUSE_U16, softfuse::kMpr121Scale, softfuse::kMpr121Offset, name}
#define PRESSURE(name) {SOFTFUSE_U16, softfuse::kVoltsPerCount, 0.0f, name}
const softfuse_channel kChannels[] = {
    ELECTRODE("electrode0"),  ELECTRODE("electrode1"),  ELECTRODE("electrode2"),  ELECTRODE("electrode3"),
    ELECTRODE("electrode4"),  ELECTRODE("electrode5"),  ELECTRODE("electrode6"),  ELECTRODE("electrode7"),
    ELECTRODE("electrode8"),  ELECTRODE("electrode9"),  ELECTRODE("electrode10"), ELECTRODE("electrode11"),
    PRESSURE("pressure0_V"),  PRESSURE("pressure1_V"),  PRESSURE("pressure2_V"),  PRESSURE("pressure3_V"),
    PRESSURE("pressure4_V"),  PRESSURE("pressure5_V"),
};
const uint16_t kCount = sizeof kChannels / sizeof kChannels[0];

softfuse_device device = softfuse_device_of(2, "Soft Finger", kChannels, kCount);
uint8_t packet[SOFTFUSE_DESCRIPTION_SIZE(kCount, 11 + 10 * 10 + 2 * 11 + 6 * 11)];

softfuse::Mpr121 electrodes(0x5A, kElectrodes);
softfuse::Board board(&device, packet, sizeof packet);

void startElectrodes() {
  board.tellSilence(!(electrodes.ready() || electrodes.begin()),
                    "the electrodes' chip does not answer: check its wiring", "the electrodes' chip answers");
}

void putChannels(softfuse_sample *sample) {
  softfuse::putElectrodes<kElectrodes>(sample, &electrodes);
  softfuse::putPins(sample, kPressurePins);
}

void setup() { board.begin(startElectrodes); }

void loop() { board.run(putChannels, startElectrodes); }
