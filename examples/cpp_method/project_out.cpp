// A method in C++: the user's hand, moved out of the object's spheres by what its deepest ball is inside, again and again.
// It shows how a method is written and is a poor one: ../project_out.py says what it lacks.
#include "hand_kinematics.hpp"

#include <vector>

struct Ball {
    double center[3], radius;
};

struct Method {
    hhsim::Hand hand;
    std::vector<Ball> palm, object;  // palm frame, world
    double stiffness;                // of the spring from the shown palm to the user's [N/m]
};

extern "C" {

Method* method_create(const hhsim::Hand* hand, const Ball* palm, int palms, const Ball* object, int objects,
                      double stiffness) {
    return new Method{*hand, {palm, palm + palms}, {object, object + objects}, stiffness};
}

void method_destroy(Method* method) { delete method; }

void method_joints(const Method* method, const hhsim::Pose* pose, double out[5][4][3]) {
    hhsim::joints(method->hand, *pose, out);
}

// Go on from this free hand: this method keeps nothing from tick to tick.
void method_begin(Method*, const hhsim::Pose*) {}

// Say where the shown hand goes for the user's, and the force on the palm [N], world.
void method_tick(Method* method, const hhsim::Pose* haptic, hhsim::Pose* shown, double palm_force[3]) {
    double joints[5][4][3], turn[3][3], shift[3] = {0.0, 0.0, 0.0};
    hhsim::joints(method->hand, *haptic, joints);
    hhsim::rotation(haptic->orientation, turn);
    std::vector<Ball> balls;
    for (int f = 0; f < 5; ++f)
        for (int k = 0; k < 4; ++k)
            balls.push_back({{joints[f][k][0], joints[f][k][1], joints[f][k][2]}, method->hand.radius[f][k]});
    for (const Ball& part : method->palm) {
        balls.push_back(part);
        hhsim::placed(*haptic, turn, part.center, balls.back().center);
    }
    for (int round = 0; round < 20; ++round) {
        double deepest = 0.0, away[3] = {0.0, 0.0, 0.0};
        for (const Ball& ball : balls)
            for (const Ball& sphere : method->object) {
                double gap[3], square = 0.0;
                for (int i = 0; i < 3; ++i) {
                    gap[i] = ball.center[i] + shift[i] - sphere.center[i];
                    square += gap[i] * gap[i];
                }
                const double distance = std::sqrt(square), depth = ball.radius + sphere.radius - distance;
                if (depth > deepest && distance > 0.0) {
                    deepest = depth;
                    for (int i = 0; i < 3; ++i) away[i] = gap[i] / distance;
                }
            }
        if (deepest == 0.0) break;
        for (int i = 0; i < 3; ++i) shift[i] += deepest * away[i];
    }
    *shown = *haptic;
    for (int i = 0; i < 3; ++i) {
        shown->position[i] += shift[i];
        palm_force[i] = method->stiffness * shift[i];
    }
}

}  // extern "C"
