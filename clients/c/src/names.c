/* Full names of topics, and the path of busd's socket. busd checks names; this only expands them. */
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "internal.h"

/* The first byte of the first sequence that is not UTF-8; NULL: there is none. */
static const char *bad_byte(const char *text)
{
    const unsigned char *at = (const unsigned char *)text;
    while (*at != 0) {
        const char *begin = (const char *)at;
        const unsigned first = *at++;
        const int more = first < 0x80   ? 0
                         : first < 0xc2 ? -1
                         : first < 0xe0 ? 1
                         : first < 0xf0 ? 2
                         : first < 0xf5 ? 3
                                        : -1;
        const unsigned least = first == 0xe0 ? 0xa0 : first == 0xf0 ? 0x90 : 0x80;
        const unsigned most = first == 0xed ? 0x9f : first == 0xf4 ? 0x8f : 0xbf;
        if (more < 0 || (more > 0 && (*at < least || *at > most)))
            return begin;
        for (int i = 0; i < more; i++)
            if ((*at++ & 0xc0) != 0x80)
                return begin;
    }
    return NULL;
}

/* Whether a text is UTF-8. busd ends a connection that sends another text. */
bool is_utf8(const char *text) { return bad_byte(text) == NULL; }

/* Replaces each byte that is not UTF-8. */
void make_utf8(char *text)
{
    for (const char *bad = text; (bad = bad_byte(bad)) != NULL;)
        text[bad - text] = '?';
}

/* The size of a text that may have been cut, without its last character if that is not whole. */
size_t whole_size(const char *text, size_t size)
{
    size_t begin = size;
    while (begin > 0 && ((unsigned char)text[begin - 1] & 0xc0) == 0x80)
        begin--;
    const unsigned first = begin == 0 ? 0 : (unsigned char)text[begin - 1];
    const size_t more = first < 0xc0 ? 0 : first < 0xe0 ? 1 : first < 0xf0 ? 2 : 3;
    return size - begin < more ? begin - 1 : size;
}

/* Ends a text that may have been cut, before its last character if that is not whole. */
void end_whole(char *text) { text[whole_size(text, strlen(text))] = '\0'; }

/* The full name of a relative, private (~) or absolute topic; NULL: no memory. */
char *topic_name(const busd_node *node, const char *topic)
{
    const char *ns = strcmp(node->ns, "/") == 0 ? "" : node->ns;
    char *full = NULL;
    int size;
    if (topic[0] == '/')
        return strdup(topic);
    if (topic[0] == '~' && (topic[1] == '/' || topic[1] == '\0'))
        size = asprintf(&full, "%s/%s%s", ns, node->name, topic + 1);
    else
        size = asprintf(&full, "%s/%s", ns, topic);
    return size < 0 ? NULL : full;
}

/* The path of the socket, as docs/configuration.md has it. 0, or -ENAMETOOLONG. */
int socket_path(char *path, size_t size)
{
    const char *chosen = getenv("BUSD_SOCKET"), *runtime = getenv("XDG_RUNTIME_DIR"), *domain = getenv("BUSD_DOMAIN");
    int length;
    if (domain == NULL || *domain == '\0')
        domain = "0";
    if (chosen != NULL && *chosen != '\0')
        length = snprintf(path, size, "%s", chosen);
    else if (runtime != NULL && *runtime == '/')
        length = snprintf(path, size, "%s/busd/%s.sock", runtime, domain);
    else
        length = snprintf(path, size, "/tmp/busd-%u/%s.sock", (unsigned)getuid(), domain);
    return length < 0 || (size_t)length >= size ? -ENAMETOOLONG : 0;
}
