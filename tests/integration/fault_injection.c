// A library to be preloaded that injects a fault into a program. The variable
// DGSFM_FAULT says which:
//   kill:N      SIGKILL before the Nth call that changes files
//   fail:N      the Nth such call fails as on a full disk
//   threads:N   no thread can be started from the Nth on
//   count:PATH  none; the number of calls that change files goes to PATH

#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <signal.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/uio.h>
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

__attribute__((destructor)) static void write_count(void) {
  const char* fault = getenv("DGSFM_FAULT");
  if (fault == NULL || strncmp(fault, "count:", 6) != 0) return;
  FILE* file = fopen(fault + 6, "w");
  if (file == NULL) abort();
  fprintf(file, "%d\n", atomic_load(&num_calls));
  fclose(file);
}

#define NEXT(name) ((__typeof__(&name))dlsym(RTLD_NEXT, #name))

// Standard streams are no files here.
static int write_fails_now(int file) {
  return file > STDERR_FILENO && fails_now();
}

ssize_t write(int file, const void* bytes, size_t size) {
  return write_fails_now(file) ? -1 : NEXT(write)(file, bytes, size);
}

ssize_t writev(int file, const struct iovec* parts, int num_parts) {
  return write_fails_now(file) ? -1 : NEXT(writev)(file, parts, num_parts);
}

ssize_t pwrite64(int file, const void* bytes, size_t size, off64_t offset) {
  return fails_now() ? -1 : NEXT(pwrite64)(file, bytes, size, offset);
}

int ftruncate64(int file, off64_t size) {
  return fails_now() ? -1 : NEXT(ftruncate64)(file, size);
}

int fdatasync(int file) { return fails_now() ? -1 : NEXT(fdatasync)(file); }

int fsync(int file) { return fails_now() ? -1 : NEXT(fsync)(file); }

// Opening changes files where it may create one.
#define DEFINE_OPEN(name)                                     \
  int name(const char* path, int flags, ...) {                \
    mode_t mode = 0;                                          \
    if ((flags & O_CREAT) != 0) {                             \
      va_list arguments;                                      \
      va_start(arguments, flags);                             \
      mode = va_arg(arguments, mode_t);                       \
      va_end(arguments);                                      \
      if (fails_now()) return -1;                             \
    }                                                         \
    return NEXT(name)(path, flags, mode);                     \
  }
DEFINE_OPEN(open)
DEFINE_OPEN(open64)

int mkdir(const char* path, mode_t mode) {
  return fails_now() ? -1 : NEXT(mkdir)(path, mode);
}

int rename(const char* from, const char* to) {
  return fails_now() ? -1 : NEXT(rename)(from, to);
}

int renameat2(int folder1, const char* from, int folder2, const char* to,
              unsigned int flags) {
  return fails_now() ? -1 : NEXT(renameat2)(folder1, from, folder2, to, flags);
}

int unlink(const char* path) {
  return fails_now() ? -1 : NEXT(unlink)(path);
}

int unlinkat(int folder, const char* path, int flags) {
  return fails_now() ? -1 : NEXT(unlinkat)(folder, path, flags);
}

int remove(const char* path) {
  return fails_now() ? -1 : NEXT(remove)(path);
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
