/* Keeps Python's state of a thread that Python has not started, such as zenoh's threads, which call back for each
 * message. Otherwise Python makes a new state for each call and deletes it when the call returns.
 *
 * Like py_run.c it has no segment, and is in this folder because the core is one compiled file.
 */
#include "py.h"

#include <pthread.h>

/* glibc 2.34 gave these functions a new version and kept the old one. Bind to the old one, which every glibc has:
 * otherwise a core that is compiled on a new system can't be loaded on an older one. */
#if defined(__x86_64__) && defined(__LP64__)
#define OLDEST "GLIBC_2.2.5"
#elif defined(__aarch64__) && defined(__LP64__)
#define OLDEST "GLIBC_2.17"
#endif
#if defined(__GLIBC__) && defined(OLDEST)
#define BIND(function) __asm__(".symver " #function ", " #function "@" OLDEST)
BIND(pthread_getspecific);
BIND(pthread_key_create);
BIND(pthread_once);
BIND(pthread_setspecific);
#endif

static pthread_once_t once = PTHREAD_ONCE_INIT;
static pthread_key_t kept; /* the kept state of this thread */
static int fault;

/* Deletes the kept state at the thread's end. Python no longer finds it by its thread, so a second state clears it. */
static void let_go(void *value)
{
    PyThreadState *const state = value;
    if (!Py_IsInitialized())
        return; /* all states have gone */
    const PyGILState_STATE before = PyGILState_Ensure();
    PyThreadState_Clear(state);
    PyGILState_Release(before);
    PyThreadState_Delete(state);
}

static void make_key(void) { fault = pthread_key_create(&kept, let_go); }

/* Forgets a kept state that Python deletes itself, as in a thread that Python has started: let_go() must not run. */
static void forget(PyObject *Py_UNUSED(capsule)) { pthread_setspecific(kept, NULL); }

PyObject *core_keep_thread(PyObject *Py_UNUSED(module), PyObject *Py_UNUSED(unused))
{
    pthread_once(&once, make_key);
    if (fault != 0 || pthread_getspecific(kept) != NULL)
        Py_RETURN_NONE;
    PyObject *const of_state = PyThreadState_GetDict(); /* borrowed; deleted with the state */
    if (of_state == NULL)
        Py_RETURN_NONE;
    PyObject *const capsule = PyCapsule_New(&kept, NULL, forget);
    const int status = capsule == NULL ? -1 : PyDict_SetItemString(of_state, "bus.shm._core.keep_thread", capsule);
    Py_XDECREF(capsule);
    if (status != 0)
        return NULL;
    if (pthread_setspecific(kept, PyThreadState_Get()) == 0)
        (void)PyGILState_Ensure(); /* without a release, so that later calls find the state */
    Py_RETURN_NONE;
}
