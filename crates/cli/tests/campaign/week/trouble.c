/* Makes trouble for a process that it is loaded into: what is to go wrong is said by files in the folder that TROUBLE names.
   hang: data of log and spools do not become durable while the file is there; slow: that takes a third of a second each time; full: the disk takes
   nothing; fail: every tenth write and sync ends with an I/O error; clock: the wall clock is off by so many seconds. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

static int there(const char *name) {
  char path[4096];
  const char *folder = getenv("TROUBLE");
  if (!folder) return 0;
  snprintf(path, sizeof path, "%s/%s", folder, name);
  return access(path, F_OK) == 0;
}

static int of_disk(int fd) {
  char link[64], path[4096];
  snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
  ssize_t n = readlink(link, path, sizeof path - 1);
  if (n <= 0) return 0;
  path[n] = 0;
  return strstr(path, ".mcap") || strstr(path, ".spool");
}

static int tenth(void) {
  static _Thread_local uint64_t state = 88172645463325252u;
  state ^= state << 13;
  state ^= state >> 7;
  state ^= state << 17;
  return state % 10 == 0;
}

static void pause_ms(long ms) {
  struct timespec time = {ms / 1000, ms % 1000 * 1000000};
  nanosleep(&time, NULL);
}

ssize_t write(int fd, const void *bytes, size_t count) {
  static ssize_t (*real)(int, const void *, size_t);
  if (!real) real = dlsym(RTLD_NEXT, "write");
  if (fd > 2 && of_disk(fd)) {
    if (there("full")) { errno = ENOSPC; return -1; }
    if (there("fail") && tenth()) {
      if (count > 1) real(fd, bytes, count / 2);
      errno = EIO;
      return -1;
    }
  }
  return real(fd, bytes, count);
}

int fdatasync(int fd) {
  static int (*real)(int);
  if (!real) real = dlsym(RTLD_NEXT, "fdatasync");
  if (of_disk(fd)) {
    while (there("hang")) pause_ms(20);
    if (there("slow")) pause_ms(300);
    if (there("fail") && tenth()) { errno = EIO; return -1; }
  }
  return real(fd);
}

int clock_gettime(clockid_t clock, struct timespec *time) {
  static int (*real)(clockid_t, struct timespec *);
  if (!real) real = dlsym(RTLD_NEXT, "clock_gettime");
  int result = real(clock, time);
  if (result == 0 && clock == CLOCK_REALTIME) {
    static _Atomic long offset, asked;
    if (asked++ % 64 == 0) {
      char path[4096];
      const char *folder = getenv("TROUBLE");
      snprintf(path, sizeof path, "%s/clock", folder ? folder : "");
      FILE *file = fopen(path, "r");
      long found = 0;
      if (file) {
        if (fscanf(file, "%ld", &found) != 1) found = 0;
        fclose(file);
      }
      offset = found;
    }
    time->tv_sec += offset;
  }
  return result;
}
