// Base of the headers that `bus interface cpp` writes: busd/types.h with views of C++17.
//
// Texts are std::string_view, bytes and lists busd::span. They are views, as in C: of the program's data in a message
// that is published, of the taken message in one that is decoded.
#ifndef BUSD_TYPES_HPP
#define BUSD_TYPES_HPP

#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>
#include <type_traits>
#include <utility>

#include <busd/types.h>

namespace busd {

namespace detail {
template <class T, class = void> struct is_list : std::false_type {};
template <class T>
struct is_list<T, std::void_t<decltype(std::declval<const T &>().items), decltype(std::declval<const T &>().count)>>
    : std::true_type {};
template <class T, class = void> struct has_data : std::false_type {};
template <class T> struct has_data<T, std::void_t<decltype(std::declval<const T &>().data())>> : std::true_type {};
// A list of C, and not a span.
template <class T> constexpr bool is_c_list = is_list<T>::value && !has_data<T>::value;
} // namespace detail

// A view of items side by side: std::span for C++17. It converts from vectors, arrays and std::span, and to std::span.
template <class T> struct span {
    T *items = nullptr;
    std::size_t count = 0;

    constexpr span() = default;
    constexpr span(T *items, std::size_t count) : items(items), count(count) {}
    template <std::size_t N> constexpr span(T (&array)[N]) : items(array), count(N) {}
    template <class From, class Item = std::remove_pointer_t<decltype(std::declval<const From &>().data())>,
              class = std::enable_if_t<std::is_convertible_v<Item (*)[], T (*)[]>>>
    constexpr span(const From &from) : items(from.data()), count(from.size())
    {
    }
    // From a list of C.
    template <class List, class Item = std::remove_pointer_t<decltype(std::declval<const List &>().items)>,
              std::enable_if_t<detail::is_c_list<List> && std::is_convertible_v<Item (*)[], T (*)[]>, int> = 0>
    constexpr span(const List &list) : items(list.items), count(list.count)
    {
    }

    constexpr T *data() const { return items; }
    constexpr std::size_t size() const { return count; }
    constexpr bool empty() const { return count == 0; }
    constexpr T *begin() const { return items; }
    constexpr T *end() const { return items + count; }
    constexpr T &operator[](std::size_t i) const { return items[i]; }
};

template <class List, std::enable_if_t<detail::is_c_list<List>, int> = 0>
span(const List &) -> span<std::remove_pointer_t<decltype(std::declval<const List &>().items)>>;

} // namespace busd

// --- the fields that have other types than in C

static inline void busd_put_text_view(busd_out *out, std::string_view text, size_t most)
{
    busd_put_text_view(out, busd_text{text.data(), text.size()}, most);
}

static inline void busd_get_text_view(busd_in *in, std::string_view *text)
{
    busd_text view;
    busd_get_text_view(in, &view);
    *text = std::string_view(view.data, view.size);
}

static inline void busd_put_bytes_view(busd_out *out, busd::span<const uint8_t> bytes, size_t most)
{
    busd_put_bytes_view(out, busd_bytes{bytes.items, bytes.count}, most);
}

static inline void busd_get_bytes_view(busd_in *in, busd::span<const uint8_t> *bytes, size_t most)
{
    busd_bytes view;
    busd_get_bytes_view(in, &view, most);
    *bytes = {static_cast<const uint8_t *>(view.data), view.size};
}

// --- what busd.hpp needs to know of a body, a message and a service

namespace busd {
template <class T> struct body_type;
template <class T> struct message_type;
template <class S> struct service_type;
} // namespace busd

#define BUSD_BODY_CPP(T)                                                                                               \
    namespace busd {                                                                                                   \
    template <> struct body_type<::T> {                                                                                \
        static int decode(const busd_message *taken, ::T *m, busd_arena *arena)                                        \
        {                                                                                                              \
            return ::T##__decode(taken, m, arena);                                                                     \
        }                                                                                                              \
    };                                                                                                                 \
    }

#define BUSD_MESSAGE_CPP(T)                                                                                            \
    BUSD_BODY_CPP(T)                                                                                                   \
    namespace busd {                                                                                                   \
    template <> struct message_type<::T> {                                                                             \
        static const busd_type *type() { return &::T##__type; }                                                        \
        static int publish(busd_publisher *publisher, const ::T *m) { return ::T##__publish(publisher, m); }           \
    };                                                                                                                 \
    }

#define BUSD_SERVICE_CPP(S)                                                                                            \
    BUSD_BODY_CPP(S##_Request)                                                                                         \
    BUSD_BODY_CPP(S##_Response)                                                                                        \
    namespace busd {                                                                                                   \
    template <> struct service_type<::S> {                                                                             \
        using request = ::S##_Request;                                                                                 \
        using response = ::S##_Response;                                                                               \
        static const busd_service_type *type() { return &::S##__service; }                                             \
        static int call(busd_client *client, const request *request, busd_answer *answer, void *user)                  \
        {                                                                                                              \
            return ::S##__call(client, request, answer, user);                                                         \
        }                                                                                                              \
        static int reply(busd_server *server, const busd_call *call, const response *response)                         \
        {                                                                                                              \
            return ::S##__reply(server, call, response);                                                               \
        }                                                                                                              \
    };                                                                                                                 \
    }

#endif
