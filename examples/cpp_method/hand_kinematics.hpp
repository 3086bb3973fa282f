// Forward kinematics of hhsim's hand, with nothing but the standard library: copy this file to where your C++ is.
//
// Units are m and rad; quaternions are unit, w x y z, and turn the palm's frame to the world; fingers go from thumb to
// little finger, joints from proximal to distal. Both structs are doubles alone, so that they are filled as one array.
#pragma once

#include <cmath>

namespace hhsim {

struct Hand {               // attributes of hhsim.HandModel, palm frame
    double base[5][3];      // first joint of each finger [m]
    double distal[5][3];    // unit direction of the straight finger at zero abduction
    double dorsal[5][3];    // unit direction out of the finger's back
    double length[5][3];    // between joint centres, the last one to the tip sphere's centre [m]
    double radius[5][4];    // at each joint and at the tip [m]: a phalanx is the hull of its two spheres
    double abduction_sign;  // +1 of a right hand, -1 of a left one
};

struct Pose {  // a single hhsim.HandConfiguration
    double position[3], orientation[4], flexion[5][3], abduction[5];
};

inline void rotation(const double q[4], double out[3][3]) {
    const double w = q[0], x = q[1], y = q[2], z = q[3];
    const double rows[3][3] = {{1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)},
                               {2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)},
                               {2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)}};
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) out[i][j] = rows[i][j];
}

// A point of the palm's frame, world [m].
inline void placed(const Pose& pose, const double turn[3][3], const double point[3], double out[3]) {
    for (int i = 0; i < 3; ++i)
        out[i] = pose.position[i] + turn[i][0] * point[0] + turn[i][1] * point[1] + turn[i][2] * point[2];
}

// Centres of the three joints and of the tip's sphere of each finger, world [m].
inline void joints(const Hand& hand, const Pose& pose, double out[5][4][3]) {
    double turn[3][3];
    rotation(pose.orientation, turn);
    for (int f = 0; f < 5; ++f) {
        const double *u = hand.distal[f], *w = hand.dorsal[f];
        // The flexion axis w x u turns u towards -w; abduction turns u in the plane of both.
        const double axis[3] = {w[1] * u[2] - w[2] * u[1], w[2] * u[0] - w[0] * u[2], w[0] * u[1] - w[1] * u[0]};
        const double c = std::cos(pose.abduction[f]), s = hand.abduction_sign * std::sin(pose.abduction[f]);
        double point[3], bend = 0.0;
        for (int i = 0; i < 3; ++i) point[i] = hand.base[f][i];
        placed(pose, turn, point, out[f][0]);
        for (int k = 0; k < 3; ++k) {
            bend += pose.flexion[f][k];
            for (int i = 0; i < 3; ++i)
                point[i] += hand.length[f][k] * (std::cos(bend) * (c * u[i] + s * axis[i]) - std::sin(bend) * w[i]);
            placed(pose, turn, point, out[f][k + 1]);
        }
    }
}

}  // namespace hhsim
