#include "colmap_ext/formats/hdf5_format.h"

#include "colmap_ext/formats/hdf5_library.h"

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <fstream>
#include <mutex>
#include <stdexcept>

#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

namespace dgsfm::internal {
namespace {

constexpr uint64_t kMaxReaderBytes = uint64_t(4) << 30;

// The other end of the connection is gone.
struct ConnectionLost : std::runtime_error {
  ConnectionLost() : std::runtime_error("connection lost") {}
};

// Numbers, texts and arrays over a socket between two processes of the same
// program.
class Connection {
 public:
  explicit Connection(int socket) : socket_(socket) {}
  ~Connection() { close(socket_); }
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  // Whoever else has the descriptor too.
  void HangUp() { shutdown(socket_, SHUT_RDWR); }

  void WriteNumber(uint64_t number) {
    Transfer(&send, &number, sizeof(number));
  }

  template <typename Values>
  void WriteValues(const Values& values) {
    WriteNumber(values.size());
    Transfer(&send, values.data(), values.size() * sizeof(values[0]));
  }

  uint64_t ReadNumber() {
    uint64_t number = 0;
    Transfer(&recv, &number, sizeof(number));
    return number;
  }

  template <typename Values>
  Values ReadValues() {
    Values values;
    const uint64_t size = ReadNumber();
    // The other process may have gone astray before it crashes.
    if (size > kMaxFileBytes / sizeof(values[0])) throw ConnectionLost();
    values.resize(size);
    Transfer(&recv, values.data(), size * sizeof(values[0]));
    return values;
  }

 private:
  // Sends from, or receives into, all of the memory, which only recv changes.
  template <typename Operation>
  void Transfer(Operation operation, const void* data, size_t size) {
    char* bytes = static_cast<char*>(const_cast<void*>(data));
    while (size > 0) {
      const ssize_t count = operation(socket_, bytes, size, MSG_NOSIGNAL);
      if (count < 0 && errno == EINTR) continue;
      if (count <= 0) throw ConnectionLost();
      bytes += count;
      size -= count;
    }
  }

  const int socket_;
};

// A request is one of these and its texts; the answer ANSWER and its content,
// or FAILURE and the reason.
enum Message : uint64_t { FIND_GROUPS, READ, ANSWER, FAILURE };

// Ends the process by SIGXCPU if it works longer than that from now on.
void LimitTime(int max_seconds) {
  rusage usage = {};
  getrusage(RUSAGE_SELF, &usage);
  rlimit limits = {};
  getrlimit(RLIMIT_CPU, &limits);
  const rlim_t seconds = usage.ru_utime.tv_sec + usage.ru_stime.tv_sec + 1;
  limits.rlim_cur = std::min(limits.rlim_max, seconds + max_seconds);
  setrlimit(RLIMIT_CPU, &limits);
}

void LimitMemory() {
  uint64_t num_pages = 0;
  std::ifstream("/proc/self/statm") >> num_pages;
  const rlim_t limit = num_pages * sysconf(_SC_PAGESIZE) + kMaxReaderBytes;
  const rlimit limits = {limit, limit};
  setrlimit(RLIMIT_AS, &limits);
}

void AnswerRequest(const Hdf5Library& file, Connection* connection) {
  const uint64_t request = connection->ReadNumber();
  if (request == FIND_GROUPS) {
    const auto name = connection->ReadValues<std::string>();
    const std::vector<std::string> groups = file.FindGroups(name);
    connection->WriteNumber(ANSWER);
    connection->WriteNumber(groups.size());
    for (const std::string& group : groups) connection->WriteValues(group);
  } else {
    const auto group = connection->ReadValues<std::string>();
    const auto name = connection->ReadValues<std::string>();
    const std::optional<NumberArray> array = file.Read(group, name);
    connection->WriteNumber(ANSWER);
    connection->WriteNumber(array.has_value());
    if (!array) return;
    connection->WriteValues(array->shape);
    connection->WriteValues(array->values);
  }
}

// What the child process does, until the other end hangs up.
void Serve(const std::string& path, int max_seconds, Connection* connection) {
  std::unique_ptr<Hdf5Library> file;
  while (true) {
    // Each request has its own time; idle time costs no processor time.
    LimitTime(max_seconds);
    try {
      if (file == nullptr) {
        file = std::make_unique<Hdf5Library>(path);
        connection->WriteNumber(ANSWER);
      }
      AnswerRequest(*file, connection);
    } catch (const ConnectionLost&) {
      return;
    } catch (const std::exception& error) {
      connection->WriteNumber(FAILURE);
      connection->WriteValues(std::string(error.what()));
      if (file == nullptr) return;
    }
  }
}

}  // namespace

bool IsHdf5Path(const std::string& path) {
  const std::string extension = LowerExtension(path);
  return extension == ".h5" || extension == ".hdf5";
}

// The child process and the connection to it.
class Hdf5File::Reader {
 public:
  Reader(const std::string& path, int max_seconds) {
    // Otherwise a child of another thread could keep this child's end open,
    // whose closing reports a crash.
    static std::mutex mutex;
    const std::lock_guard<std::mutex> lock(mutex);
    int sockets[2];
    if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, sockets) != 0) {
      throw std::runtime_error(std::strerror(errno));
    }
    // Without exec, since the child needs code of this library alone.
    process_ = fork();
    if (process_ == 0) RunChild(path, max_seconds, sockets[1]);
    // Only the child may hold this end, whose closing reports its death.
    close(sockets[1]);
    connection_ = std::make_unique<Connection>(sockets[0]);
    if (process_ < 0) throw std::runtime_error(std::strerror(errno));
  }

  ~Reader() { End(); }

  // Runs exchange(connection), whose last word is the other side's.
  template <typename Exchange>
  auto Run(const Exchange& exchange) {
    try {
      return exchange(connection_.get());
    } catch (const ConnectionLost&) {
      throw std::runtime_error(
          End() == SIGXCPU
              ? "HDF5 file that libhdf5 comes to no end with; damaged?"
              : "damaged HDF5 file, which libhdf5 crashes on");
    }
  }

  // Throws the reason if the answer is an error.
  static void ReadAnswer(Connection* connection) {
    if (connection->ReadNumber() == ANSWER) return;
    throw std::runtime_error(connection->ReadValues<std::string>());
  }

 private:
  // The signal that has ended the child process, or 0.
  int End() {
    connection_->HangUp();
    int status = 0;
    if (process_ > 0 && waitpid(process_, &status, 0) == process_) {
      signal_ = WIFSIGNALED(status) ? WTERMSIG(status) : 0;
    }
    process_ = -1;
    return signal_;
  }

  [[noreturn]] static void RunChild(const std::string& path,
                                    int max_seconds,
                                    int socket) {
    LimitMemory();
    try {
      Connection connection(socket);
      Serve(path, max_seconds, &connection);
    } catch (...) {
    }
    // Leaves the buffers and destructors of the parent alone.
    _exit(0);
  }

  pid_t process_ = -1;
  int signal_ = 0;
  std::unique_ptr<Connection> connection_;
};

Hdf5File::Hdf5File(const std::string& path, int max_seconds)
    : reader_(std::make_unique<Reader>(path, max_seconds)) {
  reader_->Run(&Reader::ReadAnswer);
}

Hdf5File::~Hdf5File() = default;

std::vector<std::string> Hdf5File::FindGroups(const std::string& name) const {
  return reader_->Run([&](Connection* connection) {
    connection->WriteNumber(FIND_GROUPS);
    connection->WriteValues(name);
    Reader::ReadAnswer(connection);
    std::vector<std::string> groups;
    for (uint64_t count = connection->ReadNumber(); count > 0; --count) {
      groups.push_back(connection->ReadValues<std::string>());
    }
    return groups;
  });
}

std::optional<NumberArray> Hdf5File::Read(const std::string& group,
                                          const std::string& name) const {
  return reader_->Run([&](Connection* connection) {
    connection->WriteNumber(READ);
    connection->WriteValues(group);
    connection->WriteValues(name);
    Reader::ReadAnswer(connection);
    std::optional<NumberArray> array;
    if (connection->ReadNumber() == 0) return array;
    array.emplace();
    array->shape = connection->ReadValues<std::vector<uint64_t>>();
    array->values = connection->ReadValues<std::vector<float>>();
    return array;
  });
}

}  // namespace dgsfm::internal
