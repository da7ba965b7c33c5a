// The C++ side of tests/system/test_c_client_services.py, with the words of service.c. The request 2000 destroys the
// server. `service_cpp list NAME` calls a service whose response has texts.
#include <csignal>
#include <cstdio>
#include <cstdlib>

#include <busd/busd.hpp>

#include "example_interfaces/srv/AddTwoInts.hpp"
#include "rcl_interfaces/srv/ListParameters.hpp"

using example_interfaces::srv::AddTwoInts;
using rcl_interfaces::srv::ListParameters;

static volatile std::sig_atomic_t has_ended = 0;

static void print_stats(const busd_service_stats &s)
{
    std::printf("requests %d responses %d errors %d late %d open %u matches %u\n", static_cast<int>(s.requests),
                static_cast<int>(s.responses), static_cast<int>(s.errors), static_cast<int>(s.late), s.open, s.matches);
    std::fflush(stdout);
}

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
    print_stats(adder->stats());
}

static void call(busd::bus &bus, busd::node &node, const char *name, char **numbers)
{
    auto client = node.create_client<AddTwoInts>(name);
    std::printf("ready\n");
    std::fflush(stdout);
    try {
        if (client.servers() == 0)
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
    print_stats(client.stats());
}

// An answer with views, which has been moved and is older than its message; and an answer that never comes.
static void list(busd::bus &bus, busd::node &node, const char *name)
{
    std::optional<busd::pending<ListParameters::Response>> first, second;
    std::vector<busd::answer<ListParameters::Response>> answers;
    {
        auto client = node.create_client<ListParameters>(name, busd::qos().depth(5));
        while (client.servers() == 0)
            bus.wait();
        const std::vector<std::string_view> prefixes = {"one", "two"};
        ListParameters::Request request;
        request.prefixes = prefixes;
        first = client.call(request);
        client.call(request, [&](auto &&answer) { answers.push_back(std::move(answer)); });
        while (!first->is_ready() || answers.empty())
            bus.wait();
        second = client.call(request);
        try {
            second->get();
        } catch (const busd::error &error) {
            std::printf("%s\n", error.what());
        }
    }
    answers.reserve(100);
    for (const auto *response : {&first->get(), &*answers[0]})
        for (const auto text : response->result.names)
            std::printf("name %s\n", std::string(text).c_str());
    second->get(); // throws
}

int main(int, char **argv)
{
    std::signal(SIGTERM, [](int) { has_ended = 1; });
    try {
        busd::bus bus("service.cpp");
        busd::node node = bus.create_node("cpp_service");
        if (std::string_view(argv[1]) == "serve")
            serve(bus, node, argv[2]);
        else if (std::string_view(argv[1]) == "list")
            list(bus, node, argv[2]);
        else
            call(bus, node, argv[2], argv + 3);
    } catch (const busd::error &error) {
        std::printf("failed: %s\n", error.what());
        return 1;
    }
}
