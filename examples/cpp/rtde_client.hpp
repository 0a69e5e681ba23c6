/// A client of Universal Robots' Real-Time Data Exchange, protocol version 2, in plain POSIX sockets: what a control
/// loop needs of it. Connecting may allocate; reading a sample and answering do not, never throw and take no lock.
#pragma once

#include <netdb.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <bit>
#include <cstdint>
#include <cstring>
#include <string>

#include "bumpstop/detection/sample_validator.hpp"

enum class RtdeRead { sample, nothing, damaged, lost };

class RtdeClient {
  public:
    static constexpr int controller_joints = 6;
    /// Joints beyond six travel in general-purpose registers: position of joint 7 in 24, its signal in 25, ...
    static constexpr int first_register = 24;

    RtdeClient() = default;
    RtdeClient(const RtdeClient&) = delete;
    RtdeClient& operator=(const RtdeClient&) = delete;
    ~RtdeClient() {
        if (socket_ >= 0) close(socket_);
    }

    /// Connects and starts the exchange of `joints` joints, 6 to 16; false: `error` says why not.
    bool open(const char* host, const char* port, int joints, bool torque, double frequency, std::string& error) {
        joints_ = joints;
        if (!connect_to(host, port)) return error = std::string("cannot connect to ") + host + ":" + port, false;
        std::string body;
        if (!ask('V', std::string("\0\2", 2), body) || body != std::string(1, '\1'))
            return error = "the controller does not speak version 2 of RTDE", false;
        std::string names = "timestamp,actual_q,actual_qd,";
        names += torque ? "actual_current_as_torque" : "actual_current";
        std::string types = "DOUBLE,VECTOR6D,VECTOR6D,VECTOR6D";
        for (int k = 0; k < 2 * (joints - controller_joints); ++k) {
            names += ",output_double_register_" + std::to_string(first_register + k);
            types += ",DOUBLE";
        }
        std::string rate(8, '\0');
        put(rate.data(), std::bit_cast<std::uint64_t>(frequency), 8);
        if (!ask('O', rate + names, body) || body.substr(1) != types || body[0] == 0)
            return error = "the controller has not got " + names, false;
        outputs_ = std::uint8_t(body[0]);
        if (!ask('I', "input_int_register_24,input_int_register_25", body) || body.substr(1) != "INT32,INT32")
            return error = "another client writes the registers of answers", false;
        inputs_ = std::uint8_t(body[0]);
        if (!ask('S', "", body) || body != std::string(1, '\1')) return error = "the controller does not start", false;
        return true;
    }

    /// The next sample, waiting for it so long.
    RtdeRead read(bumpstop::DetectorSample& sample, int milliseconds) noexcept {
        for (;;) {
            std::size_t size = 0;
            if (held() >= 3) {
                size = get(at(), 2);
                if (size < 3) return RtdeRead::lost;  // packages begin elsewhere than it seems
            }
            if (held() >= 3 && held() >= size) {
                const unsigned char* package = at();
                begin_ += size;
                if (package[2] == 'U') return taken(package + 3, size - 3, sample);
                continue;  // a text for people
            }
            pollfd one{socket_, POLLIN, 0};
            if (poll(&one, 1, milliseconds) <= 0) return RtdeRead::nothing;
            if (!receive()) return RtdeRead::lost;
        }
    }

    /// Tells the controller what to do: 0 nothing, 1 stop, 2 reverse; and the number of the alarm.
    bool answer(int what, int number) noexcept {
        unsigned char package[12] = {0, 12, 'U', inputs_};
        put(package + 4, std::uint32_t(what), 4);
        put(package + 8, std::uint32_t(number), 4);
        return send(socket_, package, sizeof package, MSG_NOSIGNAL) == ssize_t(sizeof package);
    }

  private:
    int socket_ = -1, joints_ = controller_joints;
    std::uint8_t outputs_ = 0, inputs_ = 0;
    std::array<unsigned char, 2 * 65536> buffer_{};
    std::size_t begin_ = 0, end_ = 0;

    const unsigned char* at() const noexcept { return buffer_.data() + begin_; }
    std::size_t held() const noexcept { return end_ - begin_; }

    static std::uint64_t get(const unsigned char* from, int bytes) noexcept {
        std::uint64_t value = 0;
        for (int k = 0; k < bytes; ++k) value = value << 8 | from[k];
        return value;
    }
    template <class Byte>
    static void put(Byte* to, std::uint64_t value, int bytes) noexcept {
        for (int k = bytes - 1; k >= 0; --k, value >>= 8) to[k] = Byte(value & 0xff);
    }

    bool connect_to(const char* host, const char* port) {
        addrinfo hints{}, *found = nullptr;
        hints.ai_socktype = SOCK_STREAM;
        if (getaddrinfo(host, port, &hints, &found) != 0) return false;
        for (const addrinfo* one = found; one && socket_ < 0; one = one->ai_next) {
            socket_ = socket(one->ai_family, one->ai_socktype, one->ai_protocol);
            if (socket_ >= 0 && connect(socket_, one->ai_addr, one->ai_addrlen) != 0) {
                close(socket_);
                socket_ = -1;
            }
        }
        freeaddrinfo(found);
        const int on = 1;
        if (socket_ < 0) return false;
        setsockopt(socket_, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
        // A controller that lost its power closes no connection: after a second of silence it is asked every second.
        const int tries = 3;
        setsockopt(socket_, SOL_SOCKET, SO_KEEPALIVE, &on, sizeof on);
        setsockopt(socket_, IPPROTO_TCP, TCP_KEEPIDLE, &on, sizeof on);
        setsockopt(socket_, IPPROTO_TCP, TCP_KEEPINTVL, &on, sizeof on);
        setsockopt(socket_, IPPROTO_TCP, TCP_KEEPCNT, &tries, sizeof tries);
        return true;
    }

    /// Sends a request and waits two seconds for its answer; texts for people are passed.
    bool ask(char type, const std::string& body, std::string& reply) {
        std::string package(3, '\0');
        put(package.data(), 3 + body.size(), 2);
        package[2] = type;
        package += body;
        if (send(socket_, package.data(), package.size(), MSG_NOSIGNAL) != ssize_t(package.size())) return false;
        for (;;) {
            const std::size_t size = held() >= 3 ? get(at(), 2) : 0;
            if (held() >= 3 && size < 3) return false;
            if (held() >= 3 && held() >= size) {
                const unsigned char* found = at();
                begin_ += size;
                if (found[2] == 'M') continue;
                reply.assign(reinterpret_cast<const char*>(found + 3), size - 3);
                return found[2] == type && !reply.empty();
            }
            pollfd one{socket_, POLLIN, 0};
            if (poll(&one, 1, 2000) <= 0 || !receive()) return false;
        }
    }

    bool receive() noexcept {
        // A package has at most 65535 bytes, so there is always room for the rest of one.
        if (begin_ > 0) {
            std::memmove(buffer_.data(), at(), held());
            end_ -= begin_;
            begin_ = 0;
        }
        const ssize_t count = recv(socket_, buffer_.data() + end_, buffer_.size() - end_, 0);
        if (count <= 0) return false;
        end_ += std::size_t(count);
        return true;
    }

    RtdeRead taken(const unsigned char* data, std::size_t size, bumpstop::DetectorSample& sample) const noexcept {
        const int more = joints_ - controller_joints;
        if (size != std::size_t(1 + 8 * (1 + 3 * controller_joints + 2 * more)) || data[0] != outputs_)
            return RtdeRead::damaged;
        const auto number = [&](int k) { return std::bit_cast<double>(get(data + 1 + 8 * k, 8)); };
        sample.t = number(0);
        for (int j = 0; j < controller_joints; ++j) {
            sample.q[j] = number(1 + j);
            sample.qd[j] = number(1 + controller_joints + j);
            sample.signal[j] = number(1 + 2 * controller_joints + j);
        }
        for (int j = 0; j < more; ++j) {
            sample.q[controller_joints + j] = number(1 + 3 * controller_joints + 2 * j);
            sample.signal[controller_joints + j] = number(2 + 3 * controller_joints + 2 * j);
        }
        return RtdeRead::sample;
    }
};
