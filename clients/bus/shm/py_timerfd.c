/* A timer of the kernel, for the event loop of bus.alarms. Python has both functions from 3.13 on. */
#include "py.h"

#include <sys/timerfd.h>

PyObject *core_timerfd_create(PyObject *Py_UNUSED(module), PyObject *Py_UNUSED(unused))
{
    const int number = timerfd_create(CLOCK_MONOTONIC, TFD_NONBLOCK | TFD_CLOEXEC);
    return number < 0 ? PyErr_SetFromErrno(PyExc_OSError) : PyLong_FromLong(number);
}

PyObject *core_timerfd_settime(PyObject *Py_UNUSED(module), PyObject *args)
{
    int number;
    long long due_ns;
    if (!PyArg_ParseTuple(args, "iL", &number, &due_ns))
        return NULL;
    const struct itimerspec time = {.it_value = {.tv_sec = (time_t)(due_ns / 1000000000),
                                                 .tv_nsec = (long)(due_ns % 1000000000)}};
    if (timerfd_settime(number, TFD_TIMER_ABSTIME, &time, NULL) < 0)
        return PyErr_SetFromErrno(PyExc_OSError);
    Py_RETURN_NONE;
}
