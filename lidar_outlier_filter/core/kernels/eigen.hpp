// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Eigenvalues and eigenvectors of a symmetric matrix by Jacobi's rotations (Golub and Van Loan,
// Matrix Computations, 8.5). Rows of matrices are ROW elements apart.
#pragma once

#include <cmath>

#include "array_view.hpp"
#include "levels.hpp"

namespace lidar {
namespace LEVEL {

inline constexpr int SWEEPS = 40;  // of Jacobi rotations; ten are plenty
// Of the squares of a diagonal: what is beside it is below its rounding.
inline constexpr double NEGLIGIBLE = 1e-31;

// Turns axes i and j such that their product vanishes.
template <int ROW>
inline void rotate(double (*matrix)[ROW], double (*vectors)[ROW], int size, int i, int j) {
    const double beside = matrix[i][j];
    const double ratio = (matrix[j][j] - matrix[i][i]) / (2 * beside);
    double tangent = 1 / (std::abs(ratio) + std::sqrt(ratio * ratio + 1));
    if (ratio < 0) {
        tangent = -tangent;
    }
    const double cosine = 1 / std::sqrt(tangent * tangent + 1);
    const double sine = tangent * cosine;
    matrix[i][i] -= tangent * beside;
    matrix[j][j] += tangent * beside;
    matrix[i][j] = matrix[j][i] = 0;
    for (int k = 0; k < size; ++k) {
        if (k != i && k != j) {
            const double one = matrix[k][i], other = matrix[k][j];
            matrix[k][i] = matrix[i][k] = cosine * one - sine * other;
            matrix[k][j] = matrix[j][k] = sine * one + cosine * other;
        }
        const double one = vectors[k][i], other = vectors[k][j];
        vectors[k][i] = cosine * one - sine * other;
        vectors[k][j] = sine * one + cosine * other;
    }
}

// Turns a symmetric matrix into its eigenvalues, on its diagonal; vectors are the columns.
//
// Row by row, in no order of the values.
template <int ROW>
inline void eigen(double (*matrix)[ROW], double (*vectors)[ROW], int size) {
    for (int i = 0; i < size; ++i) {
        for (int j = 0; j < size; ++j) {
            vectors[i][j] = i == j ? 1.0 : 0.0;
        }
    }
    for (int sweep = 0; sweep < SWEEPS; ++sweep) {
        double beside = 0, diagonal = 0;
        for (int i = 0; i < size; ++i) {
            diagonal += matrix[i][i] * matrix[i][i];
            for (int j = 0; j < i; ++j) {
                beside += matrix[i][j] * matrix[i][j];
            }
        }
        if (!(beside > NEGLIGIBLE * diagonal)) {
            return;
        }
        for (int i = 0; i < size - 1; ++i) {
            for (int j = i + 1; j < size; ++j) {
                if (matrix[i][j] != 0) {
                    rotate(matrix, vectors, size, i, j);
                }
            }
        }
    }
}

// Returns the place of the least eigenvalue on the diagonal, the first of those that tie.
template <int ROW>
inline int find_least(double (*matrix)[ROW], int size) {
    int least = 0;
    for (int i = 1; i < size; ++i) {
        if (matrix[i][i] < matrix[least][least]) {
            least = i;
        }
    }
    return least;
}

}  // namespace LEVEL
}  // namespace lidar
