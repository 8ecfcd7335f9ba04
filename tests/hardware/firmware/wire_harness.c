/* Encodes what the lines on standard input say with softfuse_wire.h; a packet in hexadecimal for each line.
 *
 *   device NUMBER NAME COUNT, then for each channel: TYPE SCALE OFFSET NAME    describes the device
 *   sample SEQUENCE TIME, then for each channel: RAW or -
 *   text SEQUENCE TIME TEXT
 *   asked BYTES                                                               prints a 0 or 1 for each byte
 *   room BYTES                                                                size of the buffer from now on
 *   extend MICROS ...                                                         64 bit times
 *
 * Names, texts and bytes are hexadecimal, numbers too: floats and raw values by their bits.
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>

#include "softfuse_wire.h"

static char line[200000];
static uint8_t buffer[20000];
static char names[520][260];
static softfuse_channel channels[512];
static softfuse_device device;

static uint64_t hex(char **at)
{
    return strtoull(*at, at, 16);
}

static size_t bytes_of(char **at, char *bytes)
{
    size_t size = 0u;
    unsigned int byte;
    while (**at == ' ') ++*at;
    while (sscanf(*at, "%2x", &byte) == 1 && **at != ' ' && **at != '\n') {
        bytes[size++] = (char)byte;
        *at += 2;
    }
    bytes[size] = '\0';
    return size;
}

static float float_of(uint64_t bits)
{
    const uint32_t low = (uint32_t)bits;
    float number;
    memcpy(&number, &low, sizeof number);
    return number;
}

static double double_of(uint64_t bits)
{
    double number;
    memcpy(&number, &bits, sizeof number);
    return number;
}

static void print_packet(size_t size)
{
    size_t i;
    for (i = 0u; i < size; ++i) printf("%02x", buffer[i]);
    printf("\n");
}

static void put(softfuse_sample *sample, uint8_t type, uint64_t raw)
{
    switch (type) {
    case SOFTFUSE_U8: softfuse_put_u8(sample, (uint8_t)raw); break;
    case SOFTFUSE_I8: softfuse_put_i8(sample, (int8_t)raw); break;
    case SOFTFUSE_U16: softfuse_put_u16(sample, (uint16_t)raw); break;
    case SOFTFUSE_I16: softfuse_put_i16(sample, (int16_t)raw); break;
    case SOFTFUSE_U32: softfuse_put_u32(sample, (uint32_t)raw); break;
    case SOFTFUSE_I32: softfuse_put_i32(sample, (int32_t)raw); break;
    case SOFTFUSE_F32: softfuse_put_f32(sample, float_of(raw)); break;
    default: softfuse_put_f64(sample, double_of(raw)); break;
    }
}

int main(void)
{
    static char text[20000];
    softfuse_question question;
    softfuse_clock clock = {0u, 0u};
    size_t room = sizeof buffer;
    memset(&question, 0, sizeof question);
    while (fgets(line, sizeof line, stdin) != NULL) {
        char *at = strchr(line, ' ');
        if (at == NULL) return 1;
        if (line[0] == 'd') {
            const uint16_t number = (uint16_t)hex(&at);
            uint16_t count, k;
            bytes_of(&at, names[512]);
            count = (uint16_t)hex(&at);
            for (k = 0u; k < count; ++k) {
                channels[k].type = (uint8_t)hex(&at);
                channels[k].scale = float_of(hex(&at));
                channels[k].offset = float_of(hex(&at));
                bytes_of(&at, names[k]);
                channels[k].name = names[k];
            }
            device = softfuse_device_of(number, names[512], channels, count);
            print_packet(softfuse_describe(buffer, room, &device, 0u, 0u));
        } else if (line[0] == 's') {
            const uint32_t sequence = (uint32_t)hex(&at);
            const uint64_t time_us = hex(&at);
            softfuse_sample sample;
            softfuse_sample_begin(&sample, buffer, room, &device, sequence, time_us);
            while (*at == ' ') {
                if (at[1] == '-') {
                    softfuse_put_missing(&sample);
                    at += 2;
                } else {
                    const uint16_t k = (uint16_t)(sample.next < 512u ? sample.next : 511u);
                    put(&sample, channels[k].type, hex(&at));
                }
            }
            print_packet(softfuse_sample_end(&sample));
        } else if (line[0] == 't') {
            const uint32_t sequence = (uint32_t)hex(&at);
            const uint64_t time_us = hex(&at);
            bytes_of(&at, text);
            print_packet(softfuse_remark(buffer, room, &device, sequence, time_us, text));
        } else if (line[0] == 'a') {
            const size_t size = bytes_of(&at, text);
            size_t i;
            for (i = 0u; i < size; ++i) printf("%d", softfuse_asked(&question, &device, (uint8_t)text[i]));
            printf("\n");
        } else if (line[0] == 'r') {
            room = (size_t)hex(&at);
        } else {
            while (*at == ' ') printf("%" PRIx64 " ", softfuse_extend(&clock, (uint32_t)hex(&at)));
            printf("\n");
        }
    }
    return 0;
}
