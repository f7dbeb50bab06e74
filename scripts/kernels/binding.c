/* Calls of compiled kernels from Python: the module cutenv._engine._kernels.

Built by scripts/build_kernels.py together with "table.h", which it writes, and the objects of the kernels. The functions
of Python that are declared here belong to its stable ABI, and the head of an array to NumPy's, so that neither's header
files are needed, and one library serves every later Python of a platform.

A kernel takes its arguments as 64-bit words, and returns its result as such. Its form is a text:

    d f l u b   double, float, int64, uint64, bool
    (...)       a tuple of these
    r or w      an array to be read, or written to; after it C or A (contiguous or not), its number of dimensions, and
                its dtype as three hexadecimal digits
    v           one record, with its dtype
    n           nothing, as a result                                                                                   */

#include <stdint.h>
#include <stdlib.h>
#include <string.h>

typedef struct object Object;
struct object {
    intptr_t count;
    Object *type;
};
typedef struct {
    Object head;
    char *data;
    int dimensions;
    intptr_t *shape, *strides;
    Object *base, *dtype;
    int flags;
} Array; /* of NumPy 1 and 2 */
typedef struct {
    Object head;
    intptr_t size;
    char *data;
    Object *dtype;
} Record; /* numpy.void */
typedef Object *(*Method)(Object *, Object *const *, intptr_t);
typedef struct {
    const char *name;
    void *function;
    int flags;
    const char *documentation;
} Definition;
typedef struct {
    Object head;
    void *init;
    intptr_t index;
    Object *copy;
    const char *name, *documentation;
    intptr_t size;
    Definition *methods;
    void *slots, *traverse, *clear, *free;
} Module;

#ifdef _WIN32
#define PYTHON extern __declspec(dllimport)
#define EXPORTED __declspec(dllexport)
#else
#define PYTHON extern
#define EXPORTED __attribute__((visibility("default")))
#endif

PYTHON Object PyFloat_Type, PyBool_Type, PyTuple_Type, PyLong_Type;
PYTHON Object _Py_NoneStruct, *PyExc_RuntimeError, *PyExc_SystemError;
PYTHON int PyType_IsSubtype(Object *, Object *);
PYTHON double PyFloat_AsDouble(Object *);
PYTHON Object *PyFloat_FromDouble(double), *PyLong_FromLongLong(long long), *PyLong_FromUnsignedLongLong(unsigned long long);
PYTHON Object *PyBool_FromLong(long), *PyNumber_Index(Object *), *PyErr_Occurred(void);
PYTHON long long PyLong_AsLongLong(Object *);
PYTHON unsigned long long PyLong_AsUnsignedLongLong(Object *);
PYTHON int PyObject_IsTrue(Object *);
PYTHON intptr_t PyTuple_Size(Object *), PyList_Size(Object *);
PYTHON Object *PyTuple_GetItem(Object *, intptr_t), *PyList_GetItem(Object *, intptr_t);
PYTHON Object *PyTuple_New(intptr_t), *PyList_New(intptr_t);
PYTHON int PyTuple_SetItem(Object *, intptr_t, Object *), PyList_SetItem(Object *, intptr_t, Object *);
PYTHON void Py_IncRef(Object *), Py_DecRef(Object *), PyErr_Clear(void), PyErr_SetString(Object *, const char *);
PYTHON Object *PyErr_Format(Object *, const char *, ...), *PyUnicode_FromString(const char *);
PYTHON void *PyEval_SaveThread(void);
PYTHON void PyEval_RestoreThread(void *);
PYTHON Object *PyImport_ImportModule(const char *), *PyObject_GetAttrString(Object *, const char *);
PYTHON Object *PyObject_CallFunction(Object *, const char *, ...), *PyObject_CallObject(Object *, Object *);
PYTHON Object *PyCapsule_New(void *, const char *, void *);
PYTHON void *PyCapsule_GetPointer(Object *, const char *);
PYTHON Object *PyCFunction_NewEx(Definition *, Object *, Object *);
PYTHON Object *PyModule_Create2(Module *, int);
PYTHON int PyModule_AddObjectRef(Object *, const char *, Object *), PyModule_AddStringConstant(Object *, const char *, const char *);
PYTHON int PyModule_AddIntConstant(Object *, const char *, long);

enum { FASTCALL = 0x80, SINGLE = 0x08, STABLE_ABI = 3, CONTIGUOUS = 0x1, WRITEABLE = 0x400 };

typedef int (*Kernel)(const int64_t *, int64_t *);
typedef struct {
    const char *name, *arguments, *result, *class;
    int releases; /* the interpreter's lock */
} Entry;

#include "table.h" /* ENTRIES, DTYPES, SOURCES, DIGEST, LEVELS, entries, kernels, dtypes, sources */

#if LEVELS > 1
#include <cpuid.h>
#endif

enum { WORDS = 2048, KNOWN = 16 };

static Object *array_type, *int64_type, *uint64_type, *float32_type, *bool_type, *record_type, *is_same;
static Object *known[DTYPES][KNOWN]; /* dtypes that were found to be the same */
static int level;

/* What kernels need of Numba's runtime: memory of arrays that live no longer than a call. */

typedef struct {
    int64_t count;
    void (*end)(void *, size_t, void *), *information, *data;
    size_t size;
    void *allocator;
} Memory;

void *NRT_MemInfo_alloc_aligned(size_t size, unsigned align) {
    Memory *memory = malloc(sizeof(Memory) + size + align);
    if (memory == NULL) return NULL;
    uintptr_t data = (uintptr_t)(memory + 1);
    memory->count = 1;
    memory->end = NULL;
    memory->size = size;
    memory->data = (void *)(align > 1 ? (data + align - 1) / align * align : data);
    return memory;
}

void NRT_MemInfo_call_dtor(void *memory) { free(memory); }

void *NRT_Allocate(size_t size) { return malloc(size); }

void NRT_Free(void *memory) { free(memory); }

int numba_attempt_nocopy_reshape(intptr_t n, const intptr_t *shape, const intptr_t *strides, intptr_t m,
                                 const intptr_t *wanted, intptr_t *filled, intptr_t itemsize, int fortran) {
    intptr_t step = itemsize;
    for (intptr_t k = n - 1; k >= 0; step *= shape[k--])
        if (shape[k] != 1 && strides[k] != step) return 0;
    if (fortran) return 0;
    step = itemsize;
    for (intptr_t k = m - 1; k >= 0; step *= wanted[k--]) filled[k] = step;
    return 1;
}

static int digit(char c) { return c <= '9' ? c - '0' : c - 'a' + 10; }

/* Whether a dtype is that of three digits. */
static int is_dtype(const char *digits, Object *dtype) {
    int number = digit(digits[0]) * 256 + digit(digits[1]) * 16 + digit(digits[2]);
    Object **same = known[number];
    int k = 0;
    for (; k < KNOWN && same[k] != NULL; k++)
        if (same[k] == dtype) return 1;
    Object *answer = PyObject_CallFunction(is_same, "iO", number, dtype);
    int yes = answer != NULL && PyObject_IsTrue(answer) == 1;
    if (answer != NULL) Py_DecRef(answer);
    if (yes && k < KNOWN) {
        Py_IncRef(dtype);
        same[k] = dtype;
    }
    return yes;
}

/* Fill words with an argument of the form, which ends at the returned place; NULL if it is of another, or an error. */
static const char *take(const char *form, Object *value, int64_t **words, const int64_t *end) {
    char kind = *form++;
    Object *type = value->type;
    if (*words + 20 > end) return NULL;
    switch (kind) {
    case 'd': {
        if (type != &PyFloat_Type && !PyType_IsSubtype(type, &PyFloat_Type)) return NULL;
        double number = PyFloat_AsDouble(value);
        memcpy((*words)++, &number, 8);
        return form;
    }
    case 'f': {
        if (type != float32_type) return NULL;
        float number = (float)PyFloat_AsDouble(value);
        int64_t word = 0;
        memcpy(&word, &number, 4);
        *(*words)++ = word;
        return form;
    }
    case 'b':
        if (type != &PyBool_Type && type != bool_type) return NULL;
        *(*words)++ = PyObject_IsTrue(value);
        return form;
    case 'l':
    case 'u': {
        if (type != (kind == 'l' ? int64_type : uint64_type) && (kind == 'u' || type != &PyLong_Type)) return NULL;
        Object *whole = PyNumber_Index(value);
        if (whole == NULL) return NULL;
        *(*words)++ = kind == 'l' ? PyLong_AsLongLong(whole) : (int64_t)PyLong_AsUnsignedLongLong(whole);
        Py_DecRef(whole);
        return PyErr_Occurred() ? NULL : form;
    }
    case '(': {
        if (type != &PyTuple_Type && !PyType_IsSubtype(type, &PyTuple_Type)) return NULL;
        intptr_t count = PyTuple_Size(value);
        for (intptr_t k = 0; *form != ')'; k++)
            if (k >= count || (form = take(form, PyTuple_GetItem(value, k), words, end)) == NULL) return NULL;
            else if (*form == ')' && k + 1 != count) return NULL;
        return form[-1] == '(' && count != 0 ? NULL : form + 1;
    }
    case 'v': {
        Record *record = (Record *)value;
        if (!PyType_IsSubtype(type, record_type) || !is_dtype(form, record->dtype)) return NULL;
        *(*words)++ = (int64_t)(intptr_t)record->data;
        return form + 3;
    }
    default: { /* r and w */
        Array *array = (Array *)value;
        if (type != array_type && !PyType_IsSubtype(type, array_type)) return NULL;
        int dimensions = digit(form[1]);
        if (array->dimensions != dimensions || (*form == 'C' && !(array->flags & CONTIGUOUS))) return NULL;
        if (kind == 'w' && !(array->flags & WRITEABLE)) return NULL;
        if (!is_dtype(form + 2, array->dtype)) return NULL;
        *(*words)++ = (int64_t)(intptr_t)array->data;
        for (int k = 0; k < dimensions; k++) *(*words)++ = array->shape[k];
        for (int k = 0; k < dimensions; k++) *(*words)++ = array->strides[k];
        return form + 5;
    }
    }
}

static Object *result(const char **form, const int64_t **words) {
    char kind = *(*form)++;
    double number;
    float single;
    switch (kind) {
    case 'd':
        memcpy(&number, (*words)++, 8);
        return PyFloat_FromDouble(number);
    case 'f':
        memcpy(&single, (*words)++, 4);
        return PyFloat_FromDouble(single);
    case 'l': return PyLong_FromLongLong(*(*words)++);
    case 'u': return PyLong_FromUnsignedLongLong(*(*words)++);
    case 'b': return PyBool_FromLong(*(*words)++ != 0);
    case '(': {
        intptr_t count = 0, depth = 0;
        for (const char *c = *form; depth || *c != ')'; c++) {
            if (depth == 0) count++;
            depth += (*c == '(') - (*c == ')');
        }
        Object *tuple = PyTuple_New(count);
        for (intptr_t k = 0; tuple != NULL && k < count; k++) PyTuple_SetItem(tuple, k, result(form, words));
        (*form)++;
        return tuple;
    }
    default: Py_IncRef(&_Py_NoneStruct); return &_Py_NoneStruct;
    }
}

typedef struct {
    Object *otherwise; /* called with arguments of a form that no kernel has */
    Definition definition;
    int count, numbers[];
} Overloads;

static Object *call(Object *self, Object *const *values, intptr_t count) {
    Overloads *overloads = PyCapsule_GetPointer(self, NULL);
    int64_t words[WORDS], results[16];
    for (int k = 0; k < overloads->count; k++) {
        int number = overloads->numbers[k];
        const char *form = entries[number].arguments;
        int64_t *next = words;
        intptr_t n = 0;
        while (n < count && *form && form != NULL)
            if ((form = take(form, values[n], &next, words + WORDS)) != NULL) n++;
            else break;
        if (form == NULL || *form || n != count) {
            if (PyErr_Occurred()) PyErr_Clear();
            continue;
        }
        Kernel kernel = kernels[level][number];
        void *state = entries[number].releases ? PyEval_SaveThread() : NULL;
        int status = kernel(words, results);
        if (entries[number].releases) PyEval_RestoreThread(state);
        if (status != 0) {
            PyErr_Format(PyExc_RuntimeError, "%s ended with an error (%d)", entries[number].name, status);
            return NULL;
        }
        const int64_t *filled = results;
        form = entries[number].result;
        return result(&form, &filled);
    }
    Object *arguments = PyTuple_New(count);
    if (arguments == NULL) return NULL;
    for (intptr_t n = 0; n < count; n++) {
        Py_IncRef(values[n]);
        PyTuple_SetItem(arguments, n, values[n]);
    }
    Object *answer = PyObject_CallObject(overloads->otherwise, arguments);
    Py_DecRef(arguments);
    return answer;
}

static void end_overloads(Object *capsule) {
    Overloads *overloads = PyCapsule_GetPointer(capsule, NULL);
    Py_DecRef(overloads->otherwise);
    free(overloads);
}

/* kernel(numbers, otherwise): the function of some entries of one name */
static Object *make_kernel(Object *self, Object *const *values, intptr_t count) {
    (void)self;
    intptr_t numbers = count == 2 ? PyList_Size(values[0]) : -1;
    if (numbers < 0) return PyErr_Format(PyExc_SystemError, "kernel takes a list and a function");
    Overloads *overloads = malloc(sizeof(Overloads) + (size_t)numbers * sizeof(int));
    overloads->count = (int)numbers;
    overloads->otherwise = values[1];
    overloads->definition = (Definition){"kernel", (void *)call, FASTCALL, NULL};
    for (intptr_t k = 0; k < numbers; k++) {
        overloads->numbers[k] = (int)PyLong_AsLongLong(PyList_GetItem(values[0], k));
        if (overloads->numbers[k] < 0 || overloads->numbers[k] >= ENTRIES) {
            free(overloads);
            return PyErr_Format(PyExc_SystemError, "there is no such kernel");
        }
    }
    Py_IncRef(values[1]);
    Object *capsule = PyCapsule_New(overloads, NULL, (void *)end_overloads);
    Object *function = capsule == NULL ? NULL : PyCFunction_NewEx(&overloads->definition, capsule, NULL);
    if (capsule != NULL) Py_DecRef(capsule);
    return function;
}

/* identify(same): same(number, dtype) says whether a dtype is that of the number */
static Object *identify(Object *self, Object *same) {
    (void)self;
    Py_IncRef(same);
    is_same = same;
    Py_IncRef(&_Py_NoneStruct);
    return &_Py_NoneStruct;
}

static Definition methods[] = {{"kernel", (void *)make_kernel, FASTCALL, NULL}, {"identify", (void *)identify, SINGLE, NULL}, {0}};
static Module module = {.head = {1, NULL}, .name = "_kernels", .size = -1, .methods = methods};

static void add_texts(Object *to, const char *name, const char *const *texts, int count) {
    Object *list = PyList_New(count);
    for (int k = 0; k < count; k++) PyList_SetItem(list, k, PyUnicode_FromString(texts[k]));
    PyModule_AddObjectRef(to, name, list);
    Py_DecRef(list);
}

/* The best level that processor and system have: x86-64, x86-64-v3 (AVX2) or x86-64-v4 (AVX-512). */
static int best_level(void) {
#if LEVELS > 1
    unsigned a, b, c, d, kept, wanted = bit_FMA | bit_MOVBE | bit_OSXSAVE | bit_AVX | bit_F16C;
    if (!__get_cpuid(1, &a, &b, &c, &d) || (c & wanted) != wanted) return 0;
    __asm__("xgetbv" : "=a"(kept), "=d"(d) : "c"(0)); /* registers that the system keeps */
    wanted = bit_AVX2 | bit_BMI | bit_BMI2;
    if ((kept & 0x6) != 0x6 || !__get_cpuid_count(7, 0, &a, &b, &c, &d) || (b & wanted) != wanted) return 0;
    unsigned features = b;
    if (!__get_cpuid(0x80000001, &a, &b, &c, &d) || !(c & bit_LZCNT)) return 0;
    wanted = bit_AVX512F | bit_AVX512BW | bit_AVX512CD | bit_AVX512DQ | bit_AVX512VL;
    return LEVELS > 2 && (kept & 0xe6) == 0xe6 && (features & wanted) == wanted ? 2 : 1;
#else
    return 0;
#endif
}

EXPORTED Object *PyInit__kernels(void) {
    Object *made = PyModule_Create2(&module, STABLE_ABI), *numpy = PyImport_ImportModule("numpy");
    if (made == NULL || numpy == NULL) return NULL;
    array_type = PyObject_GetAttrString(numpy, "ndarray");
    int64_type = PyObject_GetAttrString(numpy, "int64");
    uint64_type = PyObject_GetAttrString(numpy, "uint64");
    float32_type = PyObject_GetAttrString(numpy, "float32");
    bool_type = PyObject_GetAttrString(numpy, "bool_");
    record_type = PyObject_GetAttrString(numpy, "void");
    Py_DecRef(numpy);
    const char *names[ENTRIES], *classes[ENTRIES];
    for (int k = 0; k < ENTRIES; k++) {
        names[k] = entries[k].name;
        classes[k] = entries[k].class;
    }
    add_texts(made, "names", names, ENTRIES);
    add_texts(made, "classes", classes, ENTRIES);
    add_texts(made, "dtypes", dtypes, DTYPES);
    add_texts(made, "sources", sources, SOURCES);
    PyModule_AddStringConstant(made, "digest", DIGEST);
    level = best_level();
    PyModule_AddIntConstant(made, "level", level);
    return made;
}
