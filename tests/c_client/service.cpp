// The C++ side of tests/system/test_c_client_services.py, with the words of service.c. The request 2000 destroys the
// server.
#include <csignal>
#include <cstdio>
#include <cstdlib>

#include <busd/busd.hpp>

#include "example_interfaces/srv/AddTwoInts.hpp"

using example_interfaces::srv::AddTwoInts;

static volatile std::sig_atomic_t has_ended = 0;

static void serve(busd::bus &bus, busd::node &node, const char *name)
{
    using server = busd::server<AddTwoInts>;
    std::function<void()> reply_later;
    std::optional<server> adder;
    const auto add = [&](const AddTwoInts::Request &request, server::call call) {
        std::printf("request %lld\n", static_cast<long long>(request.a));
        std::fflush(stdout);
        if (reply_later)
            std::exchange(reply_later, nullptr)();
        if (request.a < 0)
            return call.fail("a is negative");
        if (request.a == 1000) {
            reply_later = [call, sum = request.a + request.b]() mutable { call.reply({sum}); };
            return;
        }
        if (request.a == 2000) {
            adder.reset();
            try {
                call.reply({0});
            } catch (const busd::error &error) {
                std::printf("in the callback: %s\n", error.what());
            }
            reply_later = [call]() mutable { call.reply({0}); };
            has_ended = 1;
            return;
        }
        call.reply({request.a + request.b});
        try {
            call.fail("twice");
            std::printf("two replies\n");
        } catch (const busd::error &error) {
            if (error.code().value() != ENOENT)
                throw;
        }
    };
    server first = node.create_server<AddTwoInts>(name, add);
    adder.emplace(std::move(first));
    std::printf("ready\n");
    std::fflush(stdout);
    while (!has_ended)
        bus.wait();
    if (!adder)
        reply_later(); // throws
}

static void call(busd::bus &bus, busd::node &node, const char *name, char **numbers)
{
    auto client = node.create_client<AddTwoInts>(name);
    std::printf("ready\n");
    std::fflush(stdout);
    try {
        client.call({}, [](auto &&) {});
    } catch (const busd::error &error) {
        std::printf("%s\n", error.what());
        std::fflush(stdout);
    }
    for (; *numbers != nullptr && !has_ended; numbers++) {
        while (client.servers() == 0)
            bus.wait();
        const AddTwoInts::Request request{std::atoll(*numbers), 1};
        if (request.a < 0) { // by a callback, which gets the reason without an exception
            bool is_answered = false;
            client.call(request, [&](auto &&answer) {
                std::printf("answer %d: %s\n", -answer.code(), answer.reason().c_str());
                is_answered = true;
            });
            while (!is_answered)
                bus.wait();
            continue;
        }
        const auto result = client.call(request);
        while (!result.is_ready())
            bus.wait();
        try {
            std::printf("answer %lld\n", static_cast<long long>(result.get().sum));
        } catch (const busd::error &error) {
            std::printf("answer %d: %s\n", -error.code().value(), error.what());
        }
    }
}

int main(int, char **argv)
{
    std::signal(SIGTERM, [](int) { has_ended = 1; });
    try {
        busd::bus bus("service.cpp");
        busd::node node = bus.create_node("cpp_service");
        if (std::string_view(argv[1]) == "serve")
            serve(bus, node, argv[2]);
        else
            call(bus, node, argv[2], argv + 3);
    } catch (const busd::error &error) {
        std::printf("failed: %s\n", error.what());
        return 1;
    }
}
