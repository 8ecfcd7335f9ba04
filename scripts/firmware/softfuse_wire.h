/* softfuse_wire.h: what a device sends to softfuse, version 1 of the protocol.
 *
 * The specification is the docstring of softfuse/hardware/wire/__init__.py. One header, C99 and C++11, no
 * allocation, no library but the compiler's headers. What makes a packet writes it into the caller's buffer and
 * returns its length, or 0 where the buffer is too small or the message is not as the device was described.
 *
 *     static const softfuse_channel channels[] = {          // value = scale * raw + offset
 *         {SOFTFUSE_U16, 5.0f / 1024.0f, 0.0f, "flow0_V"}, {SOFTFUSE_U16, 1.0f, 0.0f, "row0"}};
 *     static softfuse_device pad = softfuse_device_of(1, "Soft Pad", channels, 2);
 *     static uint8_t packet[SOFTFUSE_DESCRIPTION_SIZE(2, 8 + 7 + 4)];  // characters of all the names
 *     static softfuse_clock clock;                          // all zeros at first
 *     softfuse_sample sample;
 *     uint64_t now = softfuse_extend(&clock, micros());
 *     send(packet, softfuse_describe(packet, sizeof packet, &pad, sequence, now));  // first, and every second
 *     softfuse_sample_begin(&sample, packet, sizeof packet, &pad, sequence, now);
 *     softfuse_put_u16(&sample, (uint16_t)analogRead(A0));  // every channel, in the order of `channels`,
 *     softfuse_put_missing(&sample);                        // this one could not be read
 *     send(packet, softfuse_sample_end(&sample));
 *     ++sequence;
 *     if (softfuse_asked(&question, &pad, received_byte)) describe_again = 1;
 */
#ifndef SOFTFUSE_WIRE_H
#define SOFTFUSE_WIRE_H

#include <float.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#define SOFTFUSE_VERSION 1u
#define SOFTFUSE_EVERY_DEVICE 65535u
#define SOFTFUSE_HEADER_SIZE 16u
#define SOFTFUSE_LONGEST_BODY 16384u

/* Kinds of messages. */
#define SOFTFUSE_DESCRIPTION 1u
#define SOFTFUSE_SAMPLE 2u
#define SOFTFUSE_TEXT 3u
#define SOFTFUSE_ASK 4u

/* Types of raw values. */
#define SOFTFUSE_U8 1u
#define SOFTFUSE_I8 2u
#define SOFTFUSE_U16 3u
#define SOFTFUSE_I16 4u
#define SOFTFUSE_U32 5u
#define SOFTFUSE_I32 6u
#define SOFTFUSE_F32 7u
#define SOFTFUSE_F64 8u

/* Buffer for the packet with a body of so many bytes: CRC, COBS, the 0x00 at the end, and a spare one. */
#define SOFTFUSE_PACKET_SIZE(body) ((body) + 5u + ((body) + 2u) / 254u)
/* Buffer for a sample of so many channels, whose raw values have so many bytes together. */
#define SOFTFUSE_SAMPLE_SIZE(channels, raw) \
    SOFTFUSE_PACKET_SIZE(SOFTFUSE_HEADER_SIZE + 2u + ((channels) + 7u) / 8u + (raw))
/* Buffer for a description of so many channels, whose names and the device's have so many bytes together. */
#define SOFTFUSE_DESCRIPTION_SIZE(channels, names) \
    SOFTFUSE_PACKET_SIZE(SOFTFUSE_HEADER_SIZE + 3u + 10u * (channels) + (names))
/* Buffer for a text of so many bytes. */
#define SOFTFUSE_TEXT_SIZE(text) SOFTFUSE_PACKET_SIZE(SOFTFUSE_HEADER_SIZE + (text))

typedef struct {
    uint8_t type;     /* SOFTFUSE_U8 ... */
    float scale;      /* value = scale * raw + offset, in the unit that the name ends with; not 0 */
    float offset;
    const char *name; /* UTF-8, 1 to 255 bytes, without commas, semicolons and quotes */
} softfuse_channel;

typedef struct {
    uint16_t number;  /* 0 to 65534 */
    const char *name; /* as a channel's */
    const softfuse_channel *channels;
    uint16_t count;   /* of channels, 1 to 512 */
    uint16_t layout;  /* set by softfuse_describe */
    bool described;
} softfuse_device;

/* A packet that is being written: its body stands in the buffer `start` bytes from the front, far enough back for
 * COBS to be written over it from the front. */
typedef struct {
    uint8_t *buffer;
    size_t size;
    size_t start;
    size_t end;
    bool failed;
} softfuse_packet;

/* A sample that is being written. */
typedef struct {
    softfuse_packet packet;
    const softfuse_device *device;
    size_t presence; /* where it stands in the buffer */
    uint16_t next;   /* channel */
} softfuse_sample;

/* A 32 bit counter of microseconds carried on to 64 bits; all zeros at first. */
typedef struct {
    uint32_t last;
    uint32_t wraps;
} softfuse_clock;

/* What has come of a question of the host's; all zeros at first. */
typedef struct {
    uint8_t body[SOFTFUSE_HEADER_SIZE + 2u];
    uint8_t used;
    uint8_t code; /* COBS' last code byte, 0 before the first */
    uint8_t left; /* bytes before the next one */
    bool bad;
} softfuse_question;

static inline softfuse_device softfuse_device_of(uint16_t number, const char *name,
                                                 const softfuse_channel *channels, uint16_t count)
{
    softfuse_device device;
    device.number = number;
    device.name = name;
    device.channels = channels;
    device.count = count;
    device.layout = 0u;
    device.described = false;
    return device;
}

/* The time in 64 bits; call it at least once in 71 minutes. */
static inline uint64_t softfuse_extend(softfuse_clock *clock, uint32_t micros)
{
    if (micros < clock->last) {
        ++clock->wraps;
    }
    clock->last = micros;
    return ((uint64_t)clock->wraps << 32) | micros;
}

/* CRC-16/IBM-3740. One byte at a time without a table: the byte meets the upper half of the CRC, and since
 * x^16 = x^12 + x^5 + 1 each bit of it comes back in three places; its upper four bits meet the lower four. */
static inline uint16_t softfuse_crc(const uint8_t *data, size_t size)
{
    uint16_t crc = 0xFFFFu;
    size_t i;
    for (i = 0u; i < size; ++i) {
        uint16_t top = (uint16_t)((crc >> 8) ^ data[i]);
        top = (uint16_t)(top ^ (top >> 4));
        crc = (uint16_t)((uint32_t)crc << 8);
        crc = (uint16_t)(crc ^ (uint16_t)((uint32_t)top << 12) ^ (uint16_t)((uint32_t)top << 5) ^ top);
    }
    return crc;
}

/* ---- packets: not called from sketches ---- */

static inline void softfuse_byte(softfuse_packet *packet, uint8_t byte)
{
    if (packet->failed || packet->end >= packet->size) {
        packet->failed = true;
    } else {
        packet->buffer[packet->end++] = byte;
    }
}

/* The lowest `bytes` bytes of a number, the lowest first. */
static inline void softfuse_number(softfuse_packet *packet, uint64_t number, uint8_t bytes)
{
    uint8_t i;
    for (i = 0u; i < bytes; ++i) {
        softfuse_byte(packet, (uint8_t)(number >> (8u * i)));
    }
}

static inline uint32_t softfuse_bits_of_float(float number)
{
    uint32_t bits;
    memcpy(&bits, &number, sizeof bits);
    return bits;
}

static inline void softfuse_name(softfuse_packet *packet, const char *name)
{
    const size_t size = strlen(name);
    size_t i;
    if (size < 1u || size > 255u) {
        packet->failed = true;
        return;
    }
    softfuse_byte(packet, (uint8_t)size);
    for (i = 0u; i < size; ++i) {
        softfuse_byte(packet, (uint8_t)name[i]);
    }
}

static inline void softfuse_packet_begin(softfuse_packet *packet, uint8_t *buffer, size_t size, uint8_t kind,
                                         uint16_t device, uint32_t sequence, uint64_t time_us)
{
    packet->buffer = buffer;
    packet->size = size;
    packet->start = 1u + size / 254u;
    packet->end = packet->start;
    packet->failed = false;
    softfuse_byte(packet, SOFTFUSE_VERSION);
    softfuse_byte(packet, kind);
    softfuse_number(packet, device, 2u);
    softfuse_number(packet, sequence, 4u);
    softfuse_number(packet, time_us, 8u);
}

/* Appends the CRC, writes COBS over the body from the front of the buffer, and the 0x00; the packet's length or 0.
 * A byte is read before its place is written: COBS is ahead by 1 + i / 254 bytes after i, the body by `start`. */
static inline size_t softfuse_packet_end(softfuse_packet *packet)
{
    size_t code_at = 0u;
    size_t used = 1u;
    size_t i;
    if (packet->failed || packet->end - packet->start > SOFTFUSE_LONGEST_BODY) {
        return 0u;
    }
    softfuse_number(packet, softfuse_crc(packet->buffer + packet->start, packet->end - packet->start), 2u);
    if (packet->failed) {
        return 0u;
    }
    for (i = packet->start; i < packet->end; ++i) {
        const uint8_t byte = packet->buffer[i];
        if (used - code_at == 255u) {
            packet->buffer[code_at] = 255u;
            code_at = used++;
        }
        if (byte == 0u) {
            packet->buffer[code_at] = (uint8_t)(used - code_at);
            code_at = used++;
        } else {
            packet->buffer[used++] = byte;
        }
    }
    packet->buffer[code_at] = (uint8_t)(used - code_at);
    if (used >= packet->size) {
        return 0u;
    }
    packet->buffer[used++] = 0u;
    return used;
}

/* The device describes itself: before its first sample, every second, and when asked. `sequence` is that of the
 * next sample. */
static inline size_t softfuse_describe(uint8_t *buffer, size_t size, softfuse_device *device, uint32_t sequence,
                                       uint64_t time_us)
{
    softfuse_packet packet;
    size_t payload;
    uint16_t k;
    softfuse_packet_begin(&packet, buffer, size, SOFTFUSE_DESCRIPTION, device->number, sequence, time_us);
    payload = packet.end;
    softfuse_name(&packet, device->name);
    softfuse_number(&packet, device->count, 2u);
    for (k = 0u; k < device->count; ++k) {
        const softfuse_channel *channel = &device->channels[k];
        softfuse_byte(&packet, channel->type);
        softfuse_number(&packet, softfuse_bits_of_float(channel->scale), 4u);
        softfuse_number(&packet, softfuse_bits_of_float(channel->offset), 4u);
        softfuse_name(&packet, channel->name);
    }
    packet.failed = packet.failed || device->count < 1u || device->count > 512u;
    if (!packet.failed) {
        device->layout = softfuse_crc(buffer + payload, packet.end - payload);
        device->described = true;
    }
    return softfuse_packet_end(&packet);
}

/* A remark for the host's log, in UTF-8. */
static inline size_t softfuse_remark(uint8_t *buffer, size_t size, const softfuse_device *device,
                                     uint32_t sequence, uint64_t time_us, const char *text)
{
    softfuse_packet packet;
    softfuse_packet_begin(&packet, buffer, size, SOFTFUSE_TEXT, device->number, sequence, time_us);
    while (*text != '\0') {
        softfuse_byte(&packet, (uint8_t)*text++);
    }
    return softfuse_packet_end(&packet);
}

/* Begins a sample taken at time_us; then put every channel, in order, and end it. The device has to be described
 * before, in a buffer that was large enough. */
static inline void softfuse_sample_begin(softfuse_sample *sample, uint8_t *buffer, size_t size,
                                         const softfuse_device *device, uint32_t sequence, uint64_t time_us)
{
    uint16_t k;
    softfuse_packet_begin(&sample->packet, buffer, size, SOFTFUSE_SAMPLE, device->number, sequence, time_us);
    softfuse_number(&sample->packet, device->layout, 2u);
    sample->device = device;
    sample->next = 0u;
    sample->presence = sample->packet.end;
    for (k = 0u; k < device->count; k = (uint16_t)(k + 8u)) {
        softfuse_byte(&sample->packet, 0u);
    }
    if (!device->described) {
        sample->packet.failed = true;
    }
}

/* Puts the next channel, whose type has to be `type`. */
static inline void softfuse_put(softfuse_sample *sample, uint8_t type, uint64_t bits, uint8_t bytes, bool read)
{
    const uint16_t k = sample->next++;
    if (k >= sample->device->count || sample->device->channels[k].type != type) {
        sample->packet.failed = true;
    }
    softfuse_number(&sample->packet, bits, bytes);
    if (read && !sample->packet.failed) {
        uint8_t *presence = &sample->packet.buffer[sample->presence + k / 8u];
        *presence = (uint8_t)(*presence | (1u << (k % 8u)));
    }
}

/* The next channel, which was read. */
static inline void softfuse_put_u8(softfuse_sample *sample, uint8_t raw)
{ softfuse_put(sample, SOFTFUSE_U8, raw, 1u, true); }
static inline void softfuse_put_i8(softfuse_sample *sample, int8_t raw)
{ softfuse_put(sample, SOFTFUSE_I8, (uint8_t)raw, 1u, true); }
static inline void softfuse_put_u16(softfuse_sample *sample, uint16_t raw)
{ softfuse_put(sample, SOFTFUSE_U16, raw, 2u, true); }
static inline void softfuse_put_i16(softfuse_sample *sample, int16_t raw)
{ softfuse_put(sample, SOFTFUSE_I16, (uint16_t)raw, 2u, true); }
static inline void softfuse_put_u32(softfuse_sample *sample, uint32_t raw)
{ softfuse_put(sample, SOFTFUSE_U32, raw, 4u, true); }
static inline void softfuse_put_i32(softfuse_sample *sample, int32_t raw)
{ softfuse_put(sample, SOFTFUSE_I32, (uint32_t)raw, 4u, true); }
static inline void softfuse_put_f32(softfuse_sample *sample, float raw)
{ softfuse_put(sample, SOFTFUSE_F32, softfuse_bits_of_float(raw), 4u, true); }

#if DBL_MANT_DIG == 53 /* not on small AVRs, whose double is a float */
static inline void softfuse_put_f64(softfuse_sample *sample, double raw)
{
    uint64_t bits;
    memcpy(&bits, &raw, sizeof bits);
    softfuse_put(sample, SOFTFUSE_F64, bits, 8u, true);
}
#endif

/* The next channel, of any type, could not be read. */
static inline void softfuse_put_missing(softfuse_sample *sample)
{
    static const uint8_t sizes[] = {1u, 1u, 2u, 2u, 4u, 4u, 4u, 8u};
    uint8_t type = 0u;
    if (sample->next < sample->device->count) {
        type = sample->device->channels[sample->next].type;
    }
    if (type < SOFTFUSE_U8 || type > SOFTFUSE_F64) {
        sample->packet.failed = true;
        return;
    }
    softfuse_put(sample, type, 0u, sizes[type - 1u], false);
}

/* The sample's length, or 0 where not every channel was put as it is described. */
static inline size_t softfuse_sample_end(softfuse_sample *sample)
{
    if (sample->next != sample->device->count) {
        return 0u;
    }
    return softfuse_packet_end(&sample->packet);
}

/* Whether the host's question to describe this device, or every one, ends with this byte. Give it every byte that
 * comes. */
static inline bool softfuse_asked(softfuse_question *question, const softfuse_device *device, uint8_t byte)
{
    const uint8_t *body = question->body;
    bool asked = false;
    if (byte == 0u) {
        if (!question->bad && question->left == 0u && question->used == sizeof question->body) {
            const uint16_t crc = softfuse_crc(body, SOFTFUSE_HEADER_SIZE);
            const uint32_t number = (uint32_t)body[2] | ((uint32_t)body[3] << 8);
            asked = body[16] == (crc & 0xFFu) && body[17] == crc >> 8 && body[0] == SOFTFUSE_VERSION &&
                    body[1] == SOFTFUSE_ASK && (number == device->number || number == SOFTFUSE_EVERY_DEVICE);
        }
        question->used = question->code = question->left = 0u;
        question->bad = false;
    } else {
        const bool is_code = question->left == 0u;
        /* A code byte stands for a zero, except the first; those after 254 bytes are beyond any question. */
        const bool is_data = !is_code || question->code != 0u;
        if (is_data && question->used == sizeof question->body) {
            question->bad = true;
        } else if (is_data) {
            question->body[question->used++] = is_code ? 0u : byte;
        }
        if (is_code) {
            question->code = byte;
            question->left = (uint8_t)(byte - 1u);
        } else {
            --question->left;
        }
    }
    return asked;
}

#endif
