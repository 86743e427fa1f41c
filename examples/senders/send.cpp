// Send the scans of an array to `flgpr live --tcp`: a pattern for the program of a radar.
//
//     g++ -std=c++17 -O2 -o send send.cpp
//     ./send run.json scans.npy poses.csv 127.0.0.1:5601 4.2
//
// The files are those of send.py, which sends the same bytes: `run.json` describes the radar,
// `scans.npy` holds complex64 (scan, polarization, pair, frequency), `poses.csv` a line per scan,
// `time,x,y,z,heading,pitch,roll` in s, m and rad, after a line of names. The last argument is the
// number of scans per second. The formats stand in docs/reference/live-format.md. Only the standard
// library and POSIX sockets are used.

#include <arpa/inet.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iostream>
#include <sstream>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

namespace {

const std::string kMagic = "FLGPRSC1";
constexpr std::size_t kColumns = 7;  // time and six components of a pose

std::string read_file(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) throw std::runtime_error(path + ": cannot be read");
  std::ostringstream content;
  content << file.rdbuf();
  return content.str();
}

// Append an integer of some bytes, the lowest first.
void append_integer(std::string& data, std::uint64_t value, int bytes) {
  for (int byte = 0; byte < bytes; ++byte) {
    data.push_back(static_cast<char>((value >> (8 * byte)) & 0xff));
  }
}

// The CRC-32 of zlib: reflected, polynomial 0xEDB88320, inverted before and after.
std::uint32_t crc32(const std::string& data) {
  static const std::array<std::uint32_t, 256> table = [] {
    std::array<std::uint32_t, 256> entries{};
    for (std::uint32_t index = 0; index < entries.size(); ++index) {
      std::uint32_t entry = index;
      for (int bit = 0; bit < 8; ++bit) {
        entry = (entry & 1u) ? (entry >> 1) ^ 0xEDB88320u : entry >> 1;
      }
      entries[index] = entry;
    }
    return entries;
  }();
  std::uint32_t value = 0xffffffffu;
  for (unsigned char byte : data) value = table[(value ^ byte) & 0xff] ^ (value >> 8);
  return value ^ 0xffffffffu;
}

// A frame: its head, a header in JSON, what follows it, and a CRC-32 of all that.
std::string frame(const std::string& header, const std::string& payload = "") {
  std::string data = kMagic;
  append_integer(data, header.size(), 4);
  append_integer(data, payload.size(), 8);
  data += header;
  data += payload;
  append_integer(data, crc32(data), 4);
  return data;
}

// The samples of a NumPy file of complex64 in C order.
std::string read_samples(const std::string& path) {
  const std::string data = read_file(path);
  if (data.size() < 12 || data.compare(0, 6, "\x93NUMPY") != 0) {
    throw std::runtime_error(path + ": is no file of NumPy");
  }
  const bool is_first_version = data[6] == 1;
  const int length_bytes = is_first_version ? 2 : 4;
  std::size_t length = 0;
  for (int byte = 0; byte < length_bytes; ++byte) {
    length |= static_cast<std::size_t>(static_cast<unsigned char>(data[8 + byte])) << (8 * byte);
  }
  const std::size_t begin = 8 + length_bytes + length;
  if (begin > data.size()) throw std::runtime_error(path + ": is cut off");
  const std::string head = data.substr(8 + length_bytes, length);
  const bool is_complex64 = head.find("'<c8'") != std::string::npos;
  const bool is_c_order = head.find("'fortran_order': False") != std::string::npos;
  if (!is_complex64 || !is_c_order) {
    throw std::runtime_error(path + ": samples must be complex64 in C order");
  }
  return data.substr(begin);
}

// The lines of a table behind the line of its names, as texts.
std::vector<std::vector<std::string>> read_poses(const std::string& path) {
  std::istringstream table(read_file(path));
  std::vector<std::vector<std::string>> lines;
  std::string line;
  std::getline(table, line);
  while (std::getline(table, line)) {
    if (!line.empty() && line.back() == '\r') line.pop_back();
    std::istringstream cells(line);
    std::vector<std::string> cell_texts;
    std::string cell;
    while (std::getline(cells, cell, ',')) cell_texts.push_back(cell);
    cell_texts.resize(kColumns);  // empty ones at the end of a line
    lines.push_back(cell_texts);
  }
  return lines;
}

// A number of a table as JSON has it; null where it is unknown.
std::string number(const std::string& text) {
  char* end = nullptr;
  const double value = std::strtod(text.c_str(), &end);
  if (end == text.c_str() || !std::isfinite(value)) return "null";
  char digits[32];
  std::snprintf(digits, sizeof digits, "%.17g", value);
  return digits;
}

// The header of the frame that describes the radar: `run.json` and its kind.
std::string run_header(const std::string& description) {
  const std::size_t first = description.find('{');
  const std::size_t last = description.rfind('}');
  if (first == std::string::npos || last == std::string::npos) {
    throw std::runtime_error("the description of the radar must be a JSON object");
  }
  return "{\"kind\":\"run\"," + description.substr(first + 1, last - first);
}

// The header of the frame of a scan, from its line of the table of poses.
std::string scan_header(std::size_t scan, const std::vector<std::string>& line) {
  std::string pose = "[";
  for (std::size_t column = 1; column < kColumns; ++column) {
    const std::string component = number(line[column]);
    if (component == "null") {
      pose = "null";
      break;
    }
    pose += component + (column + 1 < kColumns ? "," : "]");
  }
  return "{\"kind\":\"scan\",\"scan\":" + std::to_string(scan) + ",\"time\":" + number(line[0]) +
         ",\"pose\":" + pose + "}";
}

// A connection to an IPv4 address and port.
class Connection {
 public:
  explicit Connection(const std::string& address) : socket_(::socket(AF_INET, SOCK_STREAM, 0)) {
    const std::size_t colon = address.rfind(':');
    if (colon == std::string::npos) throw std::runtime_error(address + ": is not ADDRESS:PORT");
    sockaddr_in place{};
    place.sin_family = AF_INET;
    place.sin_port = htons(static_cast<std::uint16_t>(std::atoi(address.c_str() + colon + 1)));
    if (::inet_pton(AF_INET, address.substr(0, colon).c_str(), &place.sin_addr) != 1) {
      throw std::runtime_error(address + ": is not an IPv4 address and a port");
    }
    if (::connect(socket_, reinterpret_cast<sockaddr*>(&place), sizeof place) != 0) {
      throw std::runtime_error(address + ": " + std::strerror(errno));
    }
    // Otherwise the last bytes of a scan may wait for the next scan.
    const int on = 1;
    ::setsockopt(socket_, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
  }
  ~Connection() { ::close(socket_); }
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  void send(const std::string& data) const {
    std::size_t sent = 0;
    while (sent < data.size()) {
      const ssize_t count = ::write(socket_, data.data() + sent, data.size() - sent);
      if (count < 0 && errno == EINTR) continue;
      if (count < 0) throw std::runtime_error(std::string("the connection broke: ") +
                                              std::strerror(errno));
      sent += static_cast<std::size_t>(count);
    }
  }

 private:
  int socket_;
};

void send_all(const std::string& description, const std::string& samples,
              const std::vector<std::vector<std::string>>& lines, const std::string& address,
              double rate) {
  if (lines.empty() || samples.size() % lines.size() != 0) {
    throw std::runtime_error("there must be as many poses as scans");
  }
  const std::size_t scan_bytes = samples.size() / lines.size();
  const Connection connection(address);
  connection.send(frame(run_header(description)));
  const auto start = std::chrono::steady_clock::now();
  for (std::size_t scan = 0; scan < lines.size(); ++scan) {
    if (rate > 0) {
      const std::chrono::duration<double> due(static_cast<double>(scan) / rate);
      std::this_thread::sleep_until(
          start + std::chrono::duration_cast<std::chrono::steady_clock::duration>(due));
    }
    const std::string payload = samples.substr(scan * scan_bytes, scan_bytes);
    connection.send(frame(scan_header(scan, lines[scan]), payload));
  }
  connection.send(frame("{\"kind\":\"end\"}"));
  std::cout << "sent " << lines.size() << " scans\n";
}

}  // namespace

int main(int count, char** arguments) {
  if (count != 5 && count != 6) {
    std::cerr << "usage: send run.json scans.npy poses.csv ADDRESS:PORT [SCANS_PER_S]\n";
    return 2;
  }
  std::signal(SIGPIPE, SIG_IGN);  // a connection that breaks is an error of write
  try {
    const double rate = count == 6 ? std::atof(arguments[5]) : 0.0;
    send_all(read_file(arguments[1]), read_samples(arguments[2]), read_poses(arguments[3]),
             arguments[4], rate);
  } catch (const std::exception& error) {
    std::cerr << error.what() << "\n";
    return 1;
  }
  return 0;
}
