/* Samples by socket, for frames.c; and marks of the descriptors in the connection's epoll. */
#ifndef BUSD_STREAM_H
#define BUSD_STREAM_H

#include <sys/uio.h>

#include "internal.h"

enum { WAKE_BELL, WAKE_SOCKET, WAKE_TIMER };

bool send_run(busd_bus *bus, struct iovec *parts, size_t count, size_t size);
bool streams_wait(const busd_bus *bus);

#endif
