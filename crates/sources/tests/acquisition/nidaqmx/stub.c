/* The functions of NI-DAQmx that gearwatch calls, with NI's types and numbers. A device of four inputs that samples at 51200 Hz / k. Sample n of every
 * input is n x 4 uV (of odd inputs: negative), by the clock, whoever reads. Files beside the library are what happens to it:
 *   lost      the buffer has overflowed (once)
 *   gone      the device has been unplugged
 *   other     another device has been plugged in
 *   overload  input 1 is driven past its range */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

typedef struct { char name[64]; double per_volt; } Input;
typedef struct { Input input[4]; int inputs; double rate; uint64_t next; int runs; } Task;

static int32_t failed;

static int32_t fail(int32_t code) { return failed = code; }

static int happens(const char *what, int once) {
    Dl_info info;
    char path[4096];
    if (!dladdr((void *)fail, &info)) return 0;
    snprintf(path, sizeof path, "%s", info.dli_fname);
    char *end = strrchr(path, '/');
    snprintf(end + 1, sizeof path - (size_t)(end + 1 - path), "%s", what);
    return once ? unlink(path) == 0 : access(path, F_OK) == 0;
}

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static double started;

int32_t DAQmxCreateTask(const char *name, void **task) {
    if (started == 0.0) started = now();
    if (*name) return fail(-200089);
    *task = calloc(1, sizeof(Task));
    return 0;
}

int32_t DAQmxClearTask(void *task) {
    free(task);
    return 0;
}

int32_t DAQmxStartTask(void *task) {
    Task *t = task;
    t->next = (uint64_t)((now() - started) * t->rate);
    t->runs = 1;
    return 0;
}

int32_t DAQmxStopTask(void *task) {
    ((Task *)task)->runs = 0;
    return 0;
}

/* Ranges are in the unit of the values, and the device has 5 V. */
static int32_t add(Task *t, const char *physical, double least, double most, double per_volt) {
    if (happens("gone", 0) || strncmp(physical, "Dev1/ai", 7) || physical[7] < '0' || physical[7] > '3') return fail(-200220);
    if (least != -most || most / per_volt > 5.0001) return fail(-200077);
    Input *input = &t->input[t->inputs++];
    snprintf(input->name, sizeof input->name, "%s", physical);
    input->per_volt = per_volt;
    return 0;
}

int32_t DAQmxCreateAIVoltageChan(void *task, const char *physical, const char *name, int32_t wiring, double least, double most, int32_t units,
                                 const char *scale) {
    if (*name || wiring != -1 || units != 10348 || scale) return fail(-200077);
    return add(task, physical, least, most, 1.0);
}

int32_t DAQmxCreateAIAccelChan(void *task, const char *physical, const char *name, int32_t wiring, double least, double most, int32_t units,
                               double sensitivity, int32_t sensitivity_units, int32_t excitation, double current, const char *scale) {
    int metric = units == 12470;
    if (*name || wiring != -1 || (units != 10186 && !metric) || sensitivity_units != 12509 || scale) return fail(-200077);
    /* A current of 2.1 mA, or none. */
    if (!(excitation == 10200 && current > 0.00209 && current < 0.00211) && !(excitation == 10230 && current == 0.0)) return fail(-200077);
    return add(task, physical, least, most, 1e3 / sensitivity * (metric ? 9.80665 : 1.0));
}

int32_t DAQmxCfgSampClkTiming(void *task, const char *source, double rate, int32_t edge, int32_t mode, uint64_t samples) {
    if (*source || edge != 10280 || mode != 10123 || samples == 0) return fail(-200077);
    if (rate > 51200.0) return fail(-200081);
    ((Task *)task)->rate = 51200.0 / (double)(int)(51200.0 / rate);
    return 0;
}

int32_t DAQmxGetSampClkRate(void *task, double *rate) {
    *rate = ((Task *)task)->rate;
    return 0;
}

int32_t DAQmxCfgInputBuffer(void *task, uint32_t samples) { return task && samples ? 0 : fail(-200077); }

int32_t DAQmxReadAnalogF64(void *task, int32_t samples, double timeout, uint32_t by_scan, double *values, uint32_t room, int32_t *read, uint32_t *reserved) {
    Task *t = task;
    double give_up = now() + timeout;
    *read = 0;
    if (!t->runs || by_scan != 1 || reserved || (uint32_t)(samples * t->inputs) > room) return fail(-200077);
    uint64_t there;
    for (;;) {
        if (happens("gone", 0)) return fail(-201003);
        if (happens("lost", 1)) return fail(-200279);
        there = (uint64_t)((now() - started) * t->rate) - t->next;
        if (there >= (uint64_t)samples || now() > give_up) break;
        usleep(1000);
    }
    int32_t taken = there < (uint64_t)samples ? (int32_t)there : samples;
    for (int32_t i = 0; i < taken; i++) {
        double volts = (double)((t->next + (uint64_t)i) & 0xfffff) * 4e-6;
        for (int k = 0; k < t->inputs; k++)
            *values++ = (t->input[k].name[7] & 1 ? -volts : volts) * t->input[k].per_volt;
    }
    t->next += (uint64_t)taken;
    *read = taken;
    return taken < samples ? fail(-200284) : 0;
}

int32_t DAQmxGetReadOverloadedChansExist(void *task, uint32_t *found) {
    (void)task;
    *found = (uint32_t)happens("overload", 0);
    return 0;
}

int32_t DAQmxGetReadOverloadedChans(void *task, char *names, uint32_t room) {
    (void)task;
    snprintf(names, room, "Dev1/ai1");
    return 0;
}

int32_t DAQmxGetDevSerialNum(const char *device, uint32_t *serial) {
    if (strcmp(device, "Dev1")) return fail(-200220);
    *serial = happens("other", 0) ? 0x1bad : 0x1dea;
    return 0;
}

int32_t DAQmxGetExtendedErrorInfo(char *text, uint32_t room) {
    snprintf(text, room, "%s\n\nStatus Code: %d", failed == -200220 ? "Device identifier is invalid." : "As the test wants it.", (int)failed);
    return 0;
}
