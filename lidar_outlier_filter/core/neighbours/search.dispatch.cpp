// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// The k nearest neighbours, see neighbours.hpp. Naive twin: test/naive/neighbours.py.
//
// The points of a leaf are near each other, so they are searched together: all points within a
// guessed reach of the leaf's box are copied side by side, and each of its points takes the k
// nearest of them without a branch for each distance, several at a stroke of the processor. Where a
// point finds fewer than k within the reach, it has found an upper bound of its own, and is
// searched again with that.
//
// Distances are squared everywhere.

#include "neighbours.hpp"

#include "nearest.hpp"

namespace lidar {
namespace LEVEL {

namespace {

// What to expect of the next leaf: the mean distance of the k-th neighbours in the last one, times
// this; and of the next point: the last one's, times that.
constexpr double REACH = 1.6, GUESS = 1.15;
constexpr Index ROUNDS = 6;  // of growing a reach that was much too short
constexpr Index HELD = 512,
                HELD_EACH = 16;  // candidates that are held, and more for each neighbour

// Searches with one thread: what it reads and writes, and its buffers.
class Search {
public:
    Search(View<const double, 2> xyz, const Tree& tree, View<const Index> order,
           View<const std::int32_t> row, View<std::int32_t, 2> index, View<bool> tied)
        : xyz_(xyz),
          tree_(tree),
          order_(order.data),
          row_(row),
          index_(index),
          tied_(tied),
          k_(index.shape[1]),
          room_(HELD + HELD_EACH * k_),
          x_(padded_room()),
          y_(padded_room()),
          z_(padded_room()),
          near_(room_ + STROKE),
          few_(room_ + STROKE),
          best_(room_ + STROKE),
          nodes_(static_cast<std::size_t>(tree_height(tree) + 1)),
          gaps_(nodes_.size()) {}

    void search(Index leaf) {
        // Only where all coincide there is more than one batch.
        for (Index begin = tree_.first[leaf]; begin < tree_.last[leaf]; begin += LEAF) {
            Index queries[LEAF], count = 0;
            for (Index q = begin; q < std::min(begin + LEAF, tree_.last[leaf]); ++q) {
                queries[count] = q;
                count += row_[q] >= 0 ? 1 : 0;
            }
            if (count > 0) {
                reach_ = search_together(leaf, queries, count);
            }
        }
    }

private:
    std::size_t padded_room() const {
        return static_cast<std::size_t>(room_ + STROKE);
    }

    // Searches points of one leaf; returns what reach to guess for the next.
    double search_together(Index leaf, Index* queries, Index count) {
        double reach = reach_;
        const Index all = count;
        sum_ = 0;
        for (Index round = 0; round < ROUNDS; ++round) {
            const Box box = around(queries, count);
            if (reach == 0) {
                reach = squared(box.low, box.high) / 4;
            }
            const Index near = collect(leaf, box, reach);
            if (near < 0) {
                break;
            }
            if (near <= k_) {
                reach *= 4;
                continue;
            }
            double further = 0;
            Index left = 0;
            for (Index i = 0; i < count; ++i) {
                const double needed = search_near(queries[i], near, reach);
                if (needed > 0) {
                    queries[left] = queries[i];
                    ++left;
                    further = std::max(further, needed);
                }
            }
            reach = further;
            count = left;
            if (count == 0) {
                return REACH * sum_ / static_cast<double>(all);
            }
        }
        // Too many or too few points around: the box is too large, or the guess was a bad one.
        for (Index i = 0; i < count; ++i) {
            write(queries[i], search_alone(queries[i]));
        }
        return 0;
    }

    Box around(const Index* queries, Index count) const {
        Box box = box_of(xyz_.row(queries[0]));
        for (Index i = 1; i < count; ++i) {
            for (int axis = 0; axis < 3; ++axis) {
                box.low[axis] = std::min(box.low[axis], xyz_(queries[i], axis));
                box.high[axis] = std::max(box.high[axis], xyz_(queries[i], axis));
            }
        }
        return box;
    }

    // Returns where the points of a leaf end that can be among anybody's k nearest, or tied.
    //
    // Where more coincide than a leaf holds, only the first: they are those of the lowest index.
    // One of them may be the point that is searched, and one more says that there is a tie.
    Index seen(Index leaf) const {
        const Index first = tree_.first[leaf], last = tree_.last[leaf];
        return last - first <= LEAF ? last : std::min(last, first + k_ + 2);
    }

    // Copies the points of all leaves within reach of the box side by side; returns how many there
    // are, or -1 if they are too many to be held. Point q of the leaf `home` is q + shift_.
    Index collect(Index home, const Box& box, double reach) {
        Index* const stack = nodes_.data();
        Index count = 0, waiting = gap(tree_, 0, box) > reach ? 0 : 1;
        stack[0] = 0;
        shift_ = 0;
        while (waiting > 0) {
            const Index node = stack[--waiting], child = tree_.child[node];
            if (child >= 0) {  // whether a child is within reach, nobody could predict
                const auto [left, right] = are_within(child, box, reach);
                stack[waiting] = child + 1;
                waiting += right;
                stack[waiting] = child;
                waiting += left;
                continue;
            }
            const Index first = tree_.first[node], last = seen(node);
            if (count + (last - first) + STROKE > room_) {
                return -1;
            }
            double limit = reach;
            if (node == home) {
                limit = INF;  // all points of the leaf itself stay, so that each finds itself
                shift_ = count - first;
            }
            count = copy(first, last, box, limit, count);
        }
        std::fill_n(x_.begin() + count, padded(count) - count, INF);
        std::fill_n(y_.begin() + count, padded(count) - count, INF);
        std::fill_n(z_.begin() + count, padded(count) - count, INF);
        return count;
    }

    // Whether a node and the next one are within reach of the box: 0 or 1.
    std::array<Index, 2> are_within(Index node, const Box& box, double reach) const {
#if defined(__AVX512F__)
        const __m512d low = _mm512_maskz_loadu_pd(0x3F, tree_.low.row(node));
        const __m512d high = _mm512_maskz_loadu_pd(0x3F, tree_.high.row(node));
        const auto twice = [](const double* p) {
            return Doubles{p[0], p[1], p[2], p[0], p[1], p[2], 0, 0};
        };
        const Doubles beside = most(most(low - twice(box.high), twice(box.low) - high), Doubles{});
        const Doubles squares = beside * beside;
        const Doubles y = __builtin_shufflevector(squares, squares, 1, 2, 3, 4, 5, 6, 7, 0);
        const Doubles z = __builtin_shufflevector(squares, squares, 2, 3, 4, 5, 6, 7, 0, 1);
        const __mmask8 near =
            _mm512_cmp_pd_mask((squares + y) + z, _mm512_set1_pd(reach), _CMP_LE_OQ);
        return {near & 1, near >> 3 & 1};
#else
        return {gap(tree_, node, box) <= reach ? 1 : 0, gap(tree_, node + 1, box) <= reach ? 1 : 0};
#endif
    }

    // Copies the points of a range that are within reach of the box, without a branch; returns how
    // many are copied then.
    Index copy(Index first, Index last, const Box& box, double reach, Index count) {
#if defined(__AVX512F__)
        for (; first < last; first += 8) {
            count = copy_eight(first, std::min<Index>(last - first, 8), box, reach, count);
        }
#else
        for (Index p = first; p < last; ++p) {
            const double* const from = xyz_.row(p);
            const std::size_t to = static_cast<std::size_t>(count);
            x_[to] = from[0];
            y_[to] = from[1];
            z_[to] = from[2];
            near_.index[to] = static_cast<std::int32_t>(p);
            count += gap(from, from, box) <= reach ? 1 : 0;
        }
#endif
        return count;
    }

#if defined(__AVX512F__)
    struct Sides {
        __m512d of[3];
    };

    // Returns three coordinates of up to eight points side by side, from their rows.
    static Sides side_by_side(const double* from, Index points) {
        const unsigned there = (1U << (3 * static_cast<unsigned>(points))) - 1;
        const __m512d a = _mm512_maskz_loadu_pd(static_cast<__mmask8>(there), from);
        const __m512d b = _mm512_maskz_loadu_pd(static_cast<__mmask8>(there >> 8), from + 8);
        const __m512d c = _mm512_maskz_loadu_pd(static_cast<__mmask8>(there >> 16), from + 16);
        const auto pick = [&](__m512i first_two, __m512i all) {
            return _mm512_permutex2var_pd(_mm512_permutex2var_pd(a, first_two, b), all, c);
        };
        return {{pick(_mm512_setr_epi64(0, 3, 6, 9, 12, 15, 0, 0),
                      _mm512_setr_epi64(0, 1, 2, 3, 4, 5, 10, 13)),
                 pick(_mm512_setr_epi64(1, 4, 7, 10, 13, 0, 0, 0),
                      _mm512_setr_epi64(0, 1, 2, 3, 4, 8, 11, 14)),
                 pick(_mm512_setr_epi64(2, 5, 8, 11, 14, 0, 0, 0),
                      _mm512_setr_epi64(0, 1, 2, 3, 4, 9, 12, 15))}};
    }

    Index copy_eight(Index first, Index points, const Box& box, double reach, Index count) {
        const Sides from = side_by_side(xyz_.row(first), points);
        Doubles squares[3];
        for (int axis = 0; axis < 3; ++axis) {
            const Doubles at = from.of[axis];
            const Doubles beside =
                most(most(at - repeat(box.high[axis]), repeat(box.low[axis]) - at), Doubles{});
            squares[axis] = beside * beside;
        }
        const Doubles distance = (squares[0] + squares[1]) + squares[2];
        const __mmask8 there = static_cast<__mmask8>((1U << static_cast<unsigned>(points)) - 1);
        const __mmask8 near =
            _mm512_mask_cmp_pd_mask(there, distance, _mm512_set1_pd(reach), _CMP_LE_OQ);
        double* const to[3] = {x_.data() + count, y_.data() + count, z_.data() + count};
        for (int axis = 0; axis < 3; ++axis) {
            _mm512_storeu_pd(to[axis], _mm512_maskz_compress_pd(near, from.of[axis]));
        }
        const __m256i number = _mm256_add_epi32(_mm256_set1_epi32(static_cast<int>(first)),
                                                _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7));
        _mm256_storeu_si256(reinterpret_cast<__m256i*>(near_.index.data() + count),
                            _mm256_maskz_compress_epi32(near, number));
        return count + __builtin_popcount(near);
    }
#endif

    // Writes the squared distances of the point from all candidates; returns how many are within
    // the reach, and within the guess.
    std::array<Index, 2> measure(const double* point, Index size, double reach) {
        const Doubles x = repeat(point[0]), y = repeat(point[1]), z = repeat(point[2]);
        const Doubles farthest = repeat(reach), guess = repeat(guess_);
        Count within, guessed;
        for (Index i = 0; i < size; i += DOUBLES) {
            const std::size_t at = static_cast<std::size_t>(i);
            const Doubles dx = load(&x_[at]) - x, dy = load(&y_[at]) - y, dz = load(&z_[at]) - z;
            const Doubles distance = (dx * dx + dy * dy) + dz * dz;
            store(&near_.distance[at], distance);
            within.add(distance, farthest);
            guessed.add(distance, guess);
        }
        return {within.total(), guessed.total()};
    }

    // Searches point q among all candidates within reach, and writes its list. Returns 0, or the
    // reach that it needs because it found too few.
    double search_near(Index q, Index near, double reach) {
        const Index size = padded(near), own = q + shift_;
        auto [within, guessed] = measure(xyz_.row(q), size, reach);
        double* const distance = near_.distance.data();
        if (0 <= own && own < near && near_.index[static_cast<std::size_t>(own)] == q) {
            distance[own] = INF;
            --within;  // it was at distance 0
            guessed -= 0 <= guess_ ? 1 : 0;
        }
        if (within < k_) {
            return enough(near, reach);
        }
        Limit lower{0, 0}, upper{reach, within};
        if (guess_ < reach && guess_ > 0) {
            (guessed >= k_ ? upper : lower) = {guess_, guessed};
        }
        const Limit limit = tighten(distance, size, k_, lower, upper, 0);
        const Index chosen = choose(distance, near_.index.data(), size, limit.value,
                                    few_.distance.data(), few_.index.data());
        write(q, chosen);
        const double last = best_.distance[static_cast<std::size_t>(k_ - 1)];
        guess_ = GUESS * last;
        sum_ += last;
        return 0;
    }

    // Returns a limit, not much further, up to which there are at least k distances.
    //
    // Fewer than k are up to the limit given, and at least k are finite.
    double enough(Index near, double limit) const {
        const double* const distance = near_.distance.data();
        double furthest = 0;
        for (Index i = 0; i < near; ++i) {
            if (furthest < distance[i] && distance[i] < INF) {
                furthest = distance[i];
            }
        }
        return tighten(distance, padded(near), k_, {0, 0}, {furthest, near}, 2 * limit).value;
    }

    // Finds the few candidates of point q by going through the tree from near to far.
    Index search_alone(Index q) {
        const Box box = box_of(xyz_.row(q));
        Index count = 0, full = 2 * k_ + LEAF, waiting = 1;
        double bound = INF;
        nodes_[0] = 0;
        gaps_[0] = 0;
        while (waiting > 0) {
            --waiting;
            const Index node = nodes_[static_cast<std::size_t>(waiting)];
            if (gaps_[static_cast<std::size_t>(waiting)] > bound) {
                continue;
            }
            if (tree_.child[node] >= 0) {
                push(node, box, waiting);
                waiting += 2;
                continue;
            }
            for (Index p = tree_.first[node]; p < seen(node); ++p) {
                const double distance = squared(xyz_.row(p), xyz_.row(q));
                few_.distance[static_cast<std::size_t>(count)] = distance;
                few_.index[static_cast<std::size_t>(count)] = static_cast<std::int32_t>(p);
                count += distance <= bound && p != q ? 1 : 0;
            }
            if (count > full) {
                bound = shorten(count);
                full = 2 * count + LEAF;
            }
        }
        if (count > k_ + SURPLUS) {
            shorten(count);
        }
        return count;
    }

    // Puts the children of a node on the stack, the nearer one on top.
    void push(Index node, const Box& box, Index waiting) {
        Index near = tree_.child[node], far = near + 1;
        double near_gap = gap(tree_, near, box), far_gap = gap(tree_, far, box);
        if (far_gap < near_gap) {
            std::swap(near, far);
            std::swap(near_gap, far_gap);
        }
        const std::size_t top = static_cast<std::size_t>(waiting);
        nodes_[top] = far;
        gaps_[top] = far_gap;
        nodes_[top + 1] = near;
        gaps_[top + 1] = near_gap;
    }

    // Drops candidates that cannot be among the k nearest, counts those left, and returns a bound.
    double shorten(Index& count) {
        double* const distance = few_.distance.data();
        double farthest = 0;
        for (Index i = 0; i < count; ++i) {
            farthest = std::max(farthest, distance[i]);
        }
        const Index size = padded(count);
        std::fill(distance + count, distance + size, INF);
        double limit = tighten(distance, size, k_, {0, 0}, {farthest, count}, 0).value;
        count = choose(distance, few_.index.data(), size, limit, best_.distance.data(),
                       best_.index.data());
        std::swap(few_, best_);
        if (count > room_ / 4) {
            // So many are tied; one behind the k-th is enough to decide.
            sort_few(order_, few_, count, best_);
            std::swap(few_, best_);
            count = k_ + 1;
            limit = few_.distance[static_cast<std::size_t>(k_ - 1)];
        }
        return limit;
    }

    // Writes the list of a point: the first k of its few candidates.
    void write(Index q, Index few) {
        sort_few(order_, few_, few, best_);
        const Index r = row_[q];
        const std::size_t k = static_cast<std::size_t>(k_);
        std::copy_n(best_.index.data(), k, index_.row(r));
        tied_[r] = few > k_ && best_.distance[k] == best_.distance[k - 1];
    }

    const View<const double, 2> xyz_;
    const Tree tree_;
    const Index* const order_;
    const View<const std::int32_t> row_;
    const View<std::int32_t, 2> index_;
    const View<bool> tied_;
    const Index k_, room_;
    double reach_ = 0, guess_ = 0, sum_ = 0;
    Index shift_ = 0;
    Buffer<double> x_, y_, z_;      // of the candidates, side by side
    Candidates near_, few_, best_;  // these; those that may be among the k nearest; sorted
    std::vector<Index> nodes_;      // a stack for walks through the tree
    std::vector<double> gaps_;
};

}  // namespace

void search_nearest(View<const double, 2> xyz, Tree tree, View<const Index> these,
                    View<const Index> order, View<const std::int32_t> row,
                    View<std::int32_t, 2> index, View<bool> tied) {
    check(xyz.shape[1] == 3 && order.size() == xyz.size() && row.size() == xyz.size(),
          "xyz must be (N, 3), order and row (N,)");
    check_tree(tree, xyz.size());
    check_indices(these, tree.child.size());
    check(tied.size() == index.size() && 0 < index.shape[1] && index.shape[1] < xyz.size(),
          "lists must be (M, k) and (M,), with k at least 1, and less than there are points");
    for (Index i = 0; i < these.size(); ++i) {
        for (Index q = tree.first[these[i]]; q < tree.last[these[i]]; ++q) {
            check(row[q] < index.size(), "rows must lie within the lists");
        }
    }
    Search search(xyz, tree, order, row, index, tied);
    for (Index i = 0; i < these.size(); ++i) {
        search.search(these[i]);
    }
}

}  // namespace LEVEL
}  // namespace lidar
