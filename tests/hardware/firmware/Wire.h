/* What the sketches need of Arduino's I2C, with an MPR121 at 0x5A and one at 0x5B. */
#ifndef WIRE_H
#define WIRE_H

#include <stddef.h>
#include <stdint.h>

class TwoWire {
 public:
  void begin();
  void setClock(uint32_t hertz);
  void beginTransmission(uint8_t address);
  size_t write(uint8_t byte);
  uint8_t endTransmission(bool stop = true);
  uint8_t requestFrom(uint8_t address, uint8_t size);
  int read();

 private:
  uint8_t address_ = 0, sent_[32] = {}, used_ = 0, next_ = 0, left_ = 0;
  bool begun_ = false;
};
extern TwoWire Wire;

#endif
