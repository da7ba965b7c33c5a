/* Reads MessagePack as hex from stdin, one message a line; prints each again as busd_put_...() encodes it. "failed" for
 * a message that is not whole. */
#include <stdio.h>

#include <busd/pack.h>

static unsigned digit(char c) { return (unsigned)(c <= '9' ? c - '0' : c - 'a' + 10); }

static void put_again(busd_in *in, busd_out *out)
{
    busd_item item;
    for (uint64_t left = 1; left > 0; left--) {
        if (!busd_get_item(in, &item))
            return;
        switch (item.kind) {
        case BUSD_NIL: busd_put_nil(out); break;
        case BUSD_BOOL: busd_put_bool(out, item.number != 0); break;
        case BUSD_UINT: busd_put_uint(out, item.number); break;
        case BUSD_INT: busd_put_int(out, (int64_t)item.number); break;
        case BUSD_FLOAT: busd_put_float(out, item.real); break;
        case BUSD_TEXT_ITEM: busd_put_text(out, (const char *)item.bytes, (size_t)item.number); break;
        case BUSD_BYTES_ITEM: busd_put_bytes(out, item.bytes, (size_t)item.number); break;
        case BUSD_ARRAY: busd_put_array(out, (size_t)item.number); left += item.number; break;
        case BUSD_MAP: busd_put_map(out, (size_t)item.number); left += 2 * item.number; break;
        default: in->failed = true; return;
        }
    }
}

int main(void)
{
    static char line[1 << 22];
    while (fgets(line, sizeof line, stdin) != NULL) {
        const size_t size = strcspn(line, "\n") / 2;
        unsigned char *bytes = (unsigned char *)malloc(size + 1);
        if (bytes == NULL)
            return 1;
        for (size_t i = 0; i < size; i++)
            bytes[i] = (unsigned char)(digit(line[2 * i]) << 4 | digit(line[2 * i + 1]));
        busd_in past = {bytes, bytes + size, false}, in = past;
        busd_out out = {0};
        put_again(&in, &out);
        const bool is_whole = busd_get_past(&past) && past.at == past.end && in.at == in.end && !in.failed;
        for (size_t i = 0; i < out.size && is_whole; i++)
            printf("%02x", out.bytes[i]);
        puts(is_whole ? "" : "failed");
        free(out.bytes);
        free(bytes);
    }
}
