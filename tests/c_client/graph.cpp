// As graph.c, in C++: `graph watch` only, with the names of nodes and the topics.
#include <csignal>
#include <cstdio>

#include <busd/busd.hpp>

static volatile std::sig_atomic_t has_ended = 0;

static void print(const char *head, const busd::graph &graph)
{
    std::string text = head;
    for (const busd_graph_node *node : graph.nodes())
        text += std::string(" ") + node->full_name;
    for (const busd_graph_topic &topic : graph.topics()) {
        text += std::string(" | ") + topic.name;
        for (const char *type : busd::span(topic.types))
            text += std::string(" ") + type;
        for (const auto *one : busd::span(topic.publishers))
            text += std::string(" from ") + one->node->name;
        for (const auto *one : busd::span(topic.subscriptions))
            text += std::string(" to ") + one->node->name;
    }
    for (const busd_graph_service &service : graph.services())
        text += std::string(" service ") + service.name;
    std::puts(text.c_str());
    std::fflush(stdout);
}

int main()
{
    std::signal(SIGTERM, [](int) { has_ended = 1; });
    std::optional<busd::graph> last;
    try {
        busd::bus bus("graph.cpp");
        std::optional<busd::watch> once;
        int calls = 0;
        once.emplace(bus.watch_graph([&](const busd::graph &) {
            once.reset();
            calls++;
        }));
        auto moved = bus.watch_graph([&](const busd::graph &graph) { last = graph; });
        const busd::watch watch = std::move(moved);
        std::puts("ready");
        std::fflush(stdout);
        std::uint64_t shown = 0;
        while (!has_ended) {
            bus.wait();
            if (last && last->get()->revision != shown)
                print("watched", *last);
            shown = last ? last->get()->revision : 0;
        }
        print("now", bus.graph());
        std::printf("once %d\n", calls);
    } catch (const busd::error &error) {
        std::printf("failed: %s\n", error.what());
        return 1;
    }
    print("kept", *last);
    std::printf("%d %d\n", last->topic("/none") != nullptr, last->service("/none") != nullptr);
}
