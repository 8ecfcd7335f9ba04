/* The soft pad of configs/pad.toml: two capacitive modules of 8 electrodes and four flow sensors, 100 Hz.
 *
 * Wiring of an Arduino Nano (ATmega328P, 5 V):
 *   MPR121 breakout with level shifter, address 0x5A (ADDR to GND): electrodes 0 to 7 are row0 ... row7
 *   MPR121 breakout with level shifter, address 0x5B (ADDR to VCC): electrodes 0 to 7 are col0 ... col7
 *   OMRON D6F-P0001A1: outputs of the cavities (-,-), (-,+), (+,-), (+,+) to A0, A1, A2, A3
 *
 * Needs ../softfuse_board.h, ../softfuse_wire.h and ../softfuse_mpr121.h:
 *   arduino-cli compile --fqbn arduino:avr:nano --library scripts/firmware scripts/firmware/pad
 * or, in the Arduino IDE, copy all three next to this file.
 */
#include "softfuse_board.h"

const uint8_t kElectrodes = 8;
const uint8_t kFlows = 4;
const uint8_t kFlowPins[kFlows] = {A0, A1, A2, A3};

#define ELECTRODE(name) {SOFTFUSE_U16, softfuse::kMpr121Scale, softfuse::kMpr121Offset, name}
#define FLOW(name) {SOFTFUSE_U16, softfuse::kVoltsPerCount, 0.0f, name}
const softfuse_channel kChannels[] = {
    ELECTRODE("row0"), ELECTRODE("row1"), ELECTRODE("row2"), ELECTRODE("row3"),
    ELECTRODE("row4"), ELECTRODE("row5"), ELECTRODE("row6"), ELECTRODE("row7"),
    ELECTRODE("col0"), ELECTRODE("col1"), ELECTRODE("col2"), ELECTRODE("col3"),
    ELECTRODE("col4"), ELECTRODE("col5"), ELECTRODE("col6"), ELECTRODE("col7"),
    FLOW("flow0_V"),   FLOW("flow1_V"),   FLOW("flow2_V"),   FLOW("flow3_V"),
};
const uint16_t kCount = sizeof kChannels / sizeof kChannels[0];

softfuse_device device = softfuse_device_of(1, "Soft Pad", kChannels, kCount);
uint8_t packet[SOFTFUSE_DESCRIPTION_SIZE(kCount, 8 + 16 * 4 + 4 * 7)];

softfuse::Mpr121 rows(0x5A, kElectrodes);
softfuse::Mpr121 columns(0x5B, kElectrodes);
softfuse::Board board(&device, packet, sizeof packet);

void startModules() {
  const bool rows_answer = rows.ready() || rows.begin();
  const bool columns_answer = columns.ready() || columns.begin();
  board.tellSilence(!(rows_answer && columns_answer),
                    "a capacitive module does not answer: check its wiring", "all capacitive modules answer");
}

void putChannels(softfuse_sample *sample) {
  softfuse::putElectrodes<kElectrodes>(sample, &rows);
  softfuse::putElectrodes<kElectrodes>(sample, &columns);
  softfuse::putPins(sample, kFlowPins);
}

void setup() { board.begin(startModules); }

void loop() { board.run(putChannels, startModules); }
