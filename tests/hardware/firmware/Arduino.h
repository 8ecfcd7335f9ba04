/* What the sketches need of the Arduino core, on a computer: time passes with what is done, Serial is standard
 * output and what the test gave, the converter reads 100 + 50 * pin. */
#ifndef ARDUINO_H
#define ARDUINO_H

#include <stddef.h>
#include <stdint.h>

const uint8_t A0 = 14, A1 = 15, A2 = 16, A3 = 17, A4 = 18, A5 = 19, A6 = 20, A7 = 21;

uint32_t micros();
int analogRead(uint8_t pin);

class SerialPort {
 public:
  void begin(unsigned long baud);
  int available();
  int read();
  size_t write(uint8_t byte);
  size_t write(const uint8_t *bytes, size_t size);
};
extern SerialPort Serial;

void setup();
void loop();

#endif
