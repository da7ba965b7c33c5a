// The C++ side of tests/system/test_c_client.py: publishes poses on /cpp/out for each text on /cpp/in, and takes its own
// poses again.
#include <csignal>
#include <cstdio>

#include <busd/busd.hpp>

#include "geometry_msgs/msg/PoseArray.h"
#include "std_msgs/msg/String.h"

static volatile std::sig_atomic_t has_ended = 0;

int main()
{
    std::signal(SIGTERM, [](int) { has_ended = 1; });
    try {
        busd::bus bus("peer.cpp");
        bus.on_event([](const busd_event &event) { std::printf("event %d: %s\n", int(event.kind), event.text); });
        busd::node node = bus.create_node("cpp_peer");
        auto out = node.create_publisher<geometry_msgs__msg__PoseArray>("/cpp/out", busd::qos().keep_all());
        auto again = node.create_subscription<geometry_msgs__msg__PoseArray>("/cpp/out", busd::qos().keep_all());
        auto in = node.create_subscription<std_msgs__msg__String>(
            "/cpp/in", busd::qos().keep_all(), [&](const std_msgs__msg__String &text, const busd_message &) {
                geometry_msgs__msg__Pose poses[3];
                for (int i = 0; i < 3; i++) {
                    geometry_msgs__msg__Pose__init(&poses[i]);
                    poses[i].position.x = i;
                }
                geometry_msgs__msg__PoseArray message;
                geometry_msgs__msg__PoseArray__init(&message);
                message.header.frame_id = text.data;
                message.poses = {poses, 3};
                if (!out.publish(message))
                    std::printf("no room\n");
            });
        std::optional<busd::subscription<geometry_msgs__msg__PoseArray>> once;
        const std::string said = "destroyed in its callback";
        once.emplace(node.create_subscription<geometry_msgs__msg__PoseArray>(
            "/cpp/out", busd::qos(), [&once, said](const geometry_msgs__msg__PoseArray &, const busd_message &) {
                once.reset();
                std::printf("%s\n", said.c_str());
            }));
        try {
            node.create_publisher<std_msgs__msg__String>("/a b");
        } catch (const busd::error &error) {
            std::printf("refused %d: %s\n", error.code().value(), error.what());
        }
        std::printf("ready\n");
        std::fflush(stdout);
        while (!has_ended) {
            bus.wait();
            while (auto got = again.take()) {
                auto moved = std::move(*got);
                const auto frame = busd::view(moved->header.frame_id);
                std::printf("%.*s %zu poses, x %g, w %g\n", int(frame.size()), frame.data(), moved->poses.count,
                            moved->poses.items[2].position.x, moved->poses.items[2].orientation.w);
            }
            std::fflush(stdout);
        }
        std::printf("taken %llu, published %llu\n", static_cast<unsigned long long>(again.stats().samples),
                    static_cast<unsigned long long>(out.stats().samples));
    } catch (const busd::error &error) {
        std::printf("failed: %s\n", error.what());
        return 1;
    }
}
