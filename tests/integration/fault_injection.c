// A library to be preloaded that injects a fault into a program. The variable
// DGSFM_FAULT says which:
//   kill:N     SIGKILL before the Nth call that changes files
//   fail:N     the Nth such call fails as on a full disk
//   threads:N  no thread can be started from the Nth on

#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <pthread.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static atomic_int num_calls;

// Whether the present call is to fail.
static int fails_now(void) {
  const int count = ++num_calls;
  const char* fault = getenv("DGSFM_FAULT");
  if (fault == NULL) return 0;
  const char* number = strchr(fault, ':');
  if (number == NULL || atoi(number + 1) != count) return 0;
  if (strncmp(fault, "kill:", 5) == 0) raise(SIGKILL);
  if (strncmp(fault, "fail:", 5) != 0) return 0;
  errno = ENOSPC;
  return 1;
}

#define NEXT(name) ((__typeof__(&name))dlsym(RTLD_NEXT, #name))

ssize_t write(int file, const void* bytes, size_t size) {
  if (file > STDERR_FILENO && fails_now()) return -1;
  return NEXT(write)(file, bytes, size);
}

ssize_t pwrite64(int file, const void* bytes, size_t size, off64_t offset) {
  return fails_now() ? -1 : NEXT(pwrite64)(file, bytes, size, offset);
}

int fdatasync(int file) { return fails_now() ? -1 : NEXT(fdatasync)(file); }

int fsync(int file) { return fails_now() ? -1 : NEXT(fsync)(file); }

int rename(const char* from, const char* to) {
  return fails_now() ? -1 : NEXT(rename)(from, to);
}

int renameat2(int folder1, const char* from, int folder2, const char* to,
              unsigned int flags) {
  return fails_now() ? -1 : NEXT(renameat2)(folder1, from, folder2, to, flags);
}

int unlinkat(int folder, const char* path, int flags) {
  return fails_now() ? -1 : NEXT(unlinkat)(folder, path, flags);
}

static atomic_int num_threads;

int pthread_create(pthread_t* thread, const pthread_attr_t* attributes,
                   void* (*start)(void*), void* argument) {
  const char* fault = getenv("DGSFM_FAULT");
  if (fault != NULL && strncmp(fault, "threads:", 8) == 0 &&
      ++num_threads >= atoi(fault + 8)) {
    return EAGAIN;
  }
  return NEXT(pthread_create)(thread, attributes, start, argument);
}
