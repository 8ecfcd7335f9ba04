"""The wire protocol, version 1: what a device sends over a serial line, a socket or a pipe.

This is the specification for writers of firmware. `scripts/firmware/softfuse_wire.h` is the reference encoder
in C99; the modules beside this file are the host's side. Neither does any I/O.

**Packet.** A packet on the line is

    COBS(body crc) 0x00            body = header payload

COBS (Cheshire and Baker, IEEE/ACM Trans. Networking 7(2), 1999) makes bytes without zeros, so that 0x00 ends
a packet and nothing else, and a receiver that lost its place finds it again at the next 0x00. Empty packets
(0x00 after 0x00) mean nothing: send one 0x00 before the first packet, so that what a bootloader printed does
not spoil it. `crc` is the CRC-16/IBM-3740 (polynomial 0x1021, start 0xFFFF, not reflected, no final xor;
0x29B1 for "123456789") of the body. A body has at most 16384 bytes. Every number is little endian, floats
are IEEE 754.

**Header,** 16 bytes:

    0   u8    version     1. COBS, the CRC and this byte stay as they are in every later version.
    1   u8    kind        of the message, see below
    2   u16   device      which device; 65535 is none, it stands for every device in ASK
    4   u32   sequence    number of the sample, from 0 at power-on, modulo 2^32; in other messages than
                          SAMPLE that of the next sample
    8   u64   time_us     the device's time [µs] since power-on, which never goes back (u32 counters have to
                          be extended); in a SAMPLE the time at which it was taken

**Kinds:**

    1   DESCRIPTION   device to host; at power-on, every second, and when asked
    2   SAMPLE        device to host
    3   TEXT          device to host; a remark for the log: all of the payload is UTF-8
    4   ASK           host to device: send your description; no payload, sequence and time_us are 0

**DESCRIPTION payload:**

    u8    bytes of the device's name (1 to 255), then the name in UTF-8
    u16   number of channels, 1 to 512, then for each channel
          u8    type: 1 u8, 2 i8, 3 u16, 4 i16, 5 u32, 6 i32, 7 f32, 8 f64
          f32   scale, finite and not 0
          f32   offset, finite
          u8    bytes of the channel's name (1 to 255), then the name in UTF-8

    value = scale * raw + offset

is in the unit that the channel's name ends with (`flow0_V`, `pressure3_V`, `cable0_mm`); names without a
unit are counts. Names are the columns of a recording: no two alike, printable, without commas, quotes, or
spaces at the ends, and none is `time_s`. The `layout` of a device is the CRC (as above) of this payload.

**SAMPLE payload:**

    u16   layout
    u8[]  presence, ceil(n / 8) bytes: bit k mod 8 (0 is the lowest) of byte k div 8 is 1 where channel k
          was read; bits from n on are 0
    raw values of all n channels, packed in the order of the description, whatever they are where not read

A channel that was not read, and a float that is not finite, is NaN on the host. A sample of a layout that the
device has not described is counted and handed on as bytes: the host never guesses, it asks.

**Example.** Device 7 named "arm" has the one channel "f_V" (u16, scale 0.5, offset -1). At 1 s, before its
first sample, it describes itself, and at 1.01 s it reads 258, that is 128 V. The layout is 0xb3d1, and on
the line are

    04 01 01 07 01 01 01 01 04 40 42 0f 01 01 01 01 06 03 61 72 6d 01 02 03
    01 01 02 3f 01 09 80 bf 03 66 5f 56 54 ff 00

    04 01 02 07 01 01 01 01 04 50 69 0f 01 01 01 01 08 d1 b3 01 02 01 f1 69 00
"""
