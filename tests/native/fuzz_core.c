/* The native core itself under libFuzzer. This process contains Python, and the core built with coverage and
 * sanitizers. It runs the target of tests/fuzz/targets.py that FUZZ_TARGET names. The Makefile builds it. */
#define PY_SSIZE_T_CLEAN
#include <Python.h>

#include <stdint.h>
#include <stdlib.h>

PyMODINIT_FUNC PyInit__core(void);
int LLVMFuzzerInitialize(int *count, char ***names);
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);
const char *__asan_default_options(void);

static PyObject *target;

/* Memory that Python keeps until its end is no leak. Freed memory in quarantine counts against the fuzzer's limit. */
const char *__asan_default_options(void) { return "detect_leaks=0:quarantine_size_mb=64"; }

static PyObject *need(PyObject *object)
{
    if (object == NULL) {
        PyErr_Print();
        abort();
    }
    return object;
}

/* Makes the module like the import system, and puts it into sys.modules. */
static void add_core(void)
{
    const char *name = "bus.shm._core";
    PyModuleDef *definition = (PyModuleDef *)need(PyInit__core());
    PyObject *types = need(PyImport_ImportModule("types"));
    PyObject *spec = need(PyObject_CallMethod(types, "SimpleNamespace", NULL));
    PyObject *text = need(PyUnicode_FromString(name));
    PyObject_SetAttrString(spec, "name", text);
    PyObject *module = need(PyModule_FromDefAndSpec(definition, spec));
    if (PyModule_ExecDef(module, definition) < 0)
        need(NULL);
    PyDict_SetItemString(PyImport_GetModuleDict(), name, module);
}

int LLVMFuzzerInitialize(int *count, char ***names)
{
    (void)count;
    (void)names;
    setenv("PYTHONMALLOC", "malloc", 1); /* then a sanitizer sees each block */
    Py_InitializeEx(0);
    add_core();
    PyObject *module = need(PyImport_ImportModule("fuzz.targets")); /* found by PYTHONPATH */
    PyObject *targets = need(PyObject_GetAttrString(module, "TARGETS"));
    const char *name = getenv("FUZZ_TARGET");
    target = need(PyMapping_GetItemString(targets, name != NULL ? name : "reader"));
    return 0;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    PyObject *result = need(PyObject_CallFunction(target, "y#", (const char *)data, (Py_ssize_t)size));
    Py_DECREF(result);
    return 0;
}
