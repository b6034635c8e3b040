/* The offline closed loop a second time, in plain C: what the compiled Python is measured against.
 *
 * Same equations, same order of operations, same arrays in and out as backend.tuning.closed_loop.simulate. Structs
 * have the fields of the NamedTuples of the same name, in their order; an array is a pointer and its shape. The springs
 * are alike and quadratic, as in both shipped parameter sets.
 */

#include <math.h>
#include <stdbool.h>
#include <stdint.h>

enum { SUBSTEPS = 4, DELAY_SLOTS = 64, COLUMNS = 13, ENTRY_WIDTH = 7 };

static const double T_s = 1e-3;
static const double INNER_TRACKING_TIME_S = 0.030;
static const double OUTER_TRACKING_TIME_S = 0.1;
static const double PULL_FILTER_TIME_S = 0.05;
static const double HYSTERESIS = 0.2;
static const double REST_FACTOR = 1.2, NEAR_FACTOR_Q = 4.0, NEAR_FACTOR_S = 20.0;
static const double HOLD_GAIN = 1.5;
static const double SUBNORMAL = 1e-200;

typedef struct { double r_m, r_j, J_j, B_j; } Joint;
typedef struct { double c0, c1, omega_smooth; } Friction;
typedef struct { double J_m, B_m, K_t, tau_e; Friction friction; } Motor;
typedef struct { double k[3], x_slack, x_solid, F_solid, k_solid; } Spring;
typedef struct { Joint joint; Motor motor_A, motor_B; Spring spring_A, spring_B; } Dynamics;
typedef struct { double q, q_dot, theta_A, omega_A, tau_A, theta_B, omega_B, tau_B; } PlantState; /* no bristles: friction is smoothed */
typedef struct { double joint_step, motor_step, force_step, voltage_step; int64_t delay_ticks; } SensorModel;
typedef struct { double F_max, q_max, deflection_max; } SafetyBounds;
typedef struct { Dynamics plant; SensorModel sensors; SafetyBounds bounds; double u_max; } Rig;
typedef struct { double q, theta_A, theta_B, F_A, F_B, S_true; } Measurement;
typedef struct {
    const double *q_ref; int64_t ticks;
    const double *S_ref; int64_t S_ref_ticks;
    const double *F_push; int64_t F_push_ticks;
    const double *noise; int64_t noise_ticks, noise_sides;
} Inputs;

typedef struct { double k_p, k_i, k_d, t_f; } MotorGains;
typedef struct { double integral, integral_f, y_f; } MotorState;
typedef struct { MotorGains A, B; } PairGains;
typedef struct { MotorState A, B; } PairState;
typedef struct { double k_p, k_i, k_r; } OuterGains;
typedef struct { double integral; } OuterState;
typedef struct { const double *entries; int64_t count, width; int64_t interpolate; } Schedule;
typedef struct { double r_m, r_j, k_0, k_1, k_2; } Decoupler;
typedef struct { double F_floor, F_ceiling, q_max, S_floor, S_ceiling; } Envelope;
typedef struct { double K_A, T_A, K_B, T_B, K_t_A, K_t_B, J_j, B_j, tau_e_A, tau_e_B; } Model; /* of a trajectory: unused */
typedef struct { double budget; Model model; double dead_zone_q, dead_zone_S; } Tracking;
typedef struct {
    PairGains motors;
    Schedule schedule;
    Decoupler decoupler;
    Envelope envelope;
    double omega_max, u_max;
    Tracking tracking;
} Tuning;
typedef struct { double q_ref, S_ref; } References;
typedef struct {
    References governor;
    OuterState position, stiffness;
    double pull;
    PairState motors;
    OuterGains position_gains, stiffness_gains;
    PairGains motor_gains;
    double active, correction_q, correction_S;
} State; /* the fields of a trajectory follow, which this twin leaves as they are */
typedef struct { bool resting, arrived; } Rest;
typedef struct { double u_A, u_B, theta_A_ref, theta_B_ref, S, q_ref_gov, S_ref_gov; } Output;

/* ---- plant ---- */

static double tension(const Spring *spring, double x) {
    if (x <= spring->x_slack) return 0.0;
    if (x > spring->x_solid) return spring->F_solid + spring->k_solid * (x - spring->x_solid);
    return (spring->k[2] * x + spring->k[1]) * x + spring->k[0];
}

static double tension_slope(const Spring *spring, double x) {
    if (x <= spring->x_slack) return 0.0;
    if (x > spring->x_solid) return spring->k_solid;
    return 2.0 * spring->k[2] * x + spring->k[1];
}

static double elongation_A(const Joint *joint, const PlantState *x) { return joint->r_m * x->theta_A - joint->r_j * x->q; }
static double elongation_B(const Joint *joint, const PlantState *x) { return joint->r_m * x->theta_B + joint->r_j * x->q; }

static double motor_acceleration(const Motor *motor, double omega, double tau, double load) {
    const Friction *f = &motor->friction;
    double friction = (f->c0 + f->c1 * load) * tanh(omega / f->omega_smooth);
    return (tau - motor->B_m * omega - load - friction) / motor->J_m;
}

static PlantState derivative(const Dynamics *plant, const PlantState *x, double u_A, double u_B, double tau_ext) {
    const Joint *joint = &plant->joint;
    double F_A = tension(&plant->spring_A, elongation_A(joint, x));
    double F_B = tension(&plant->spring_B, elongation_B(joint, x));
    return (PlantState){
        x->q_dot,
        (joint->r_j * (F_A - F_B) + tau_ext - joint->B_j * x->q_dot) / joint->J_j,
        x->omega_A,
        motor_acceleration(&plant->motor_A, x->omega_A, x->tau_A, joint->r_m * F_A),
        (plant->motor_A.K_t * u_A - x->tau_A) / plant->motor_A.tau_e,
        x->omega_B,
        motor_acceleration(&plant->motor_B, x->omega_B, x->tau_B, joint->r_m * F_B),
        (plant->motor_B.K_t * u_B - x->tau_B) / plant->motor_B.tau_e,
    };
}

static PlantState axpy(double h, const PlantState *d, const PlantState *x) {
    return (PlantState){
        x->q + h * d->q,             x->q_dot + h * d->q_dot,     x->theta_A + h * d->theta_A,
        x->omega_A + h * d->omega_A, x->tau_A + h * d->tau_A,     x->theta_B + h * d->theta_B,
        x->omega_B + h * d->omega_B, x->tau_B + h * d->tau_B,
    };
}

static double flush(double value) { return fabs(value) > SUBNORMAL ? value : 0.0; }

static PlantState advance(const Dynamics *plant, PlantState x, double u_A, double u_B, double tau_ext) {
    double h = T_s / SUBSTEPS;
    for (int substep = 0; substep < SUBSTEPS; substep++) {
        PlantState at;
        PlantState d1 = derivative(plant, &x, u_A, u_B, tau_ext);
        at = axpy(0.5 * h, &d1, &x);
        PlantState d2 = derivative(plant, &at, u_A, u_B, tau_ext);
        at = axpy(0.5 * h, &d2, &x);
        PlantState d3 = derivative(plant, &at, u_A, u_B, tau_ext);
        at = axpy(h, &d3, &x);
        PlantState d4 = derivative(plant, &at, u_A, u_B, tau_ext);
        x = axpy(h / 6.0, &d4, &x);
        x = axpy(h / 3.0, &d3, &x);
        x = axpy(h / 3.0, &d2, &x);
        x = axpy(h / 6.0, &d1, &x);
    }
    return (PlantState){x.q, flush(x.q_dot), x.theta_A, flush(x.omega_A), flush(x.tau_A),
                        x.theta_B, flush(x.omega_B), flush(x.tau_B)};
}

/* ---- sensors, outputs, safety module ---- */

static double quantise(double value, double step) { return step == 0.0 ? value : floor(value / step + 0.5) * step; }
static double clamp(double value, double bound) { return value < -bound ? -bound : value > bound ? bound : value; }

static Measurement sense(const Rig *rig, const PlantState *x, double line[2][DELAY_SLOTS], int64_t tick,
                         double noise_A, double noise_B) {
    const Dynamics *plant = &rig->plant;
    const SensorModel *sensors = &rig->sensors;
    double x_A = elongation_A(&plant->joint, x), x_B = elongation_B(&plant->joint, x);
    line[0][tick % DELAY_SLOTS] = tension(&plant->spring_A, x_A);
    line[1][tick % DELAY_SLOTS] = tension(&plant->spring_B, x_B);
    int64_t past = tick - sensors->delay_ticks;
    if (past < 0) past = 0;
    double S = plant->joint.r_j * plant->joint.r_j
               * (tension_slope(&plant->spring_A, x_A) + tension_slope(&plant->spring_B, x_B));
    return (Measurement){
        quantise(x->q, sensors->joint_step),
        quantise(x->theta_A, sensors->motor_step),
        quantise(x->theta_B, sensors->motor_step),
        quantise(line[0][past % DELAY_SLOTS] + noise_A, sensors->force_step),
        quantise(line[1][past % DELAY_SLOTS] + noise_B, sensors->force_step),
        S,
    };
}

static bool exceeded(const Rig *rig, const PlantState *x) {
    const Dynamics *plant = &rig->plant;
    return tension(&plant->spring_A, elongation_A(&plant->joint, x)) > rig->bounds.F_max
           || tension(&plant->spring_B, elongation_B(&plant->joint, x)) > rig->bounds.F_max
           || fabs(x->q) > rig->bounds.q_max;
}

/* ---- controllers ---- */

static double filtered(const MotorGains *gains, const MotorState *state, double y, double *integral_f, double *y_f) {
    double pass_through = 1.0 - exp(-T_s / gains->t_f);
    *integral_f = state->integral_f + pass_through * (state->integral - state->integral_f);
    *y_f = state->y_f + pass_through * (y - state->y_f);
    return *integral_f - gains->k_p * *y_f - gains->k_d / gains->t_f * (y - *y_f);
}

static double motor_step(const MotorGains *gains, MotorState *state, double r, double y, double u_max, bool resting,
                         double *excess) {
    double integral_f, y_f;
    double u = filtered(gains, state, y, &integral_f, &y_f);
    double u_limited = clamp(u, u_max);
    double e = resting ? 0.0 : r - y;
    double hold_correction = resting ? HOLD_GAIN * gains->k_p * (y_f - state->y_f) : 0.0;
    double integral = state->integral + T_s * (gains->k_i * e + (u_limited - u) / INNER_TRACKING_TIME_S);
    *state = (MotorState){integral - hold_correction, integral_f - hold_correction, y_f};
    *excess = u - u_limited;
    return u_limited;
}

static void motor_bumpless(const MotorGains *before, const MotorGains *after, MotorState *state, double y) {
    double unused_integral, unused_y;
    double offset = filtered(before, state, y, &unused_integral, &unused_y)
                    - filtered(after, state, y, &unused_integral, &unused_y);
    state->integral += offset;
    state->integral_f += offset;
}

static double beyond(double e, double dead_zone) { return e - fmin(fmax(e, -dead_zone), dead_zone); }

static double outer_step(const OuterGains *gains, OuterState *state, double r, double y, double correction,
                         double dead_zone) {
    double u = state->integral + gains->k_r * r - gains->k_p * y;
    state->integral += T_s * (gains->k_i * beyond(r - y, dead_zone) + correction);
    return u;
}

static void outer_bumpless(const OuterGains *before, const OuterGains *after, OuterState *state, double r, double y) {
    state->integral = state->integral + (after->k_p - before->k_p) * y - (after->k_r - before->k_r) * r;
}

static void motor_positions(const Decoupler *d, double q_c, double S_c, double *theta_A, double *theta_B) {
    double difference = d->r_j / d->r_m * q_c;
    double common = (S_c - 2.0 * d->k_1 * (d->r_j * d->r_j)) / (4.0 * d->k_2 * (d->r_j * d->r_j) * d->r_m);
    *theta_A = difference + common;
    *theta_B = -difference + common;
}

static bool govern(const Tuning *tuning, References *state, double q_ref, double S_ref) {
    double now_A, now_B, target_A, target_B;
    motor_positions(&tuning->decoupler, state->q_ref, state->S_ref, &now_A, &now_B);
    motor_positions(&tuning->decoupler, q_ref, S_ref, &target_A, &target_B);
    double distance = fmax(fabs(target_A - now_A), fabs(target_B - now_B));
    double reach = tuning->omega_max * T_s;
    bool held_back = distance > reach;
    double share = reach / distance;
    *state = held_back ? (References){state->q_ref + share * (q_ref - state->q_ref),
                                      state->S_ref + share * (S_ref - state->S_ref)}
                       : (References){q_ref, S_ref};
    return held_back;
}

static double select_entry(const Schedule *schedule, double active, double S) {
    const double *entries = schedule->entries;
    int64_t last = schedule->count - 1;
    if (schedule->interpolate || active < 0.0 || active > (double)last || active != floor(active)) {
        double place = 0.0;
        for (int64_t lower = 0; lower < last; lower++) {
            double below = entries[lower * ENTRY_WIDTH], above = entries[(lower + 1) * ENTRY_WIDTH];
            if (below <= S) place = (double)lower + fmin((S - below) / (above - below), 1.0);
        }
        return schedule->interpolate ? place : floor(place + 0.5);
    }
    int64_t entry = (int64_t)active;
    while (entry < last && 0.5 * (entries[entry * ENTRY_WIDTH] + entries[(entry + 1) * ENTRY_WIDTH]) + HYSTERESIS < S)
        entry++;
    while (entry > 0 && 0.5 * (entries[(entry - 1) * ENTRY_WIDTH] + entries[entry * ENTRY_WIDTH]) - HYSTERESIS > S)
        entry--;
    return (double)entry;
}

static void gains_at(const Schedule *schedule, double active, OuterGains *position, OuterGains *stiffness) {
    int64_t lower = (int64_t)active;
    int64_t upper = lower + 1 < schedule->count ? lower + 1 : schedule->count - 1;
    double share = active - (double)lower, mixed[ENTRY_WIDTH];
    for (int i = 0; i < ENTRY_WIDTH; i++)
        mixed[i] = (1.0 - share) * schedule->entries[lower * ENTRY_WIDTH + i]
                   + share * schedule->entries[upper * ENTRY_WIDTH + i];
    *position = (OuterGains){mixed[1], mixed[2], mixed[3]};
    *stiffness = (OuterGains){mixed[4], mixed[5], mixed[6]};
}

static double stiffness_under(const Decoupler *d, double F) {
    return 2.0 * (d->r_j * d->r_j) * sqrt(fmax(d->k_1 * d->k_1 + 4.0 * d->k_2 * (F - d->k_0), 0.0));
}

static double allowed_stiffness(const Tuning *tuning, State *state, double S_c, const Measurement *m) {
    state->pull += (1.0 - exp(-T_s / PULL_FILTER_TIME_S)) * (m->F_A - m->F_B - state->pull);
    double share = 0.5 * fabs(state->pull);
    double lowest = stiffness_under(&tuning->decoupler, tuning->envelope.F_floor + share);
    double highest = stiffness_under(&tuning->decoupler, tuning->envelope.F_ceiling - share);
    return fmin(fmax(S_c, lowest), highest);
}

static void update_rest(const Tracking *tracking, Rest *rest, bool constant, double e_q, double e_S) {
    rest->resting = constant && fabs(e_q) <= REST_FACTOR * tracking->dead_zone_q && fabs(e_S) <= tracking->dead_zone_S;
    rest->arrived = rest->resting
                    || (constant && rest->arrived && fabs(e_q) <= NEAR_FACTOR_Q * tracking->dead_zone_q
                        && fabs(e_S) <= NEAR_FACTOR_S * tracking->dead_zone_S);
}

static double dead_zone(const Rest *rest, double width) { return rest->resting ? INFINITY : rest->arrived ? width : 0.0; }

static Output cascade_step(const Tuning *tuning, State *state, Rest *rest, double q_ref, double S_ref,
                           const Measurement *m) {
    const Decoupler *d = &tuning->decoupler;
    const Tracking *tracking = &tuning->tracking;
    References before = state->governor;
    double S = 2.0 * (d->r_j * d->r_j) * (d->k_1 + d->k_2 * d->r_m * (m->theta_A + m->theta_B));
    govern(tuning, &state->governor, q_ref, S_ref);
    References reference = state->governor;

    OuterGains gains_q, gains_S;
    state->active = select_entry(&tuning->schedule, state->active, reference.S_ref);
    gains_at(&tuning->schedule, state->active, &gains_q, &gains_S);
    outer_bumpless(&state->position_gains, &gains_q, &state->position, reference.q_ref, m->q);
    outer_bumpless(&state->stiffness_gains, &gains_S, &state->stiffness, reference.S_ref, S);
    motor_bumpless(&state->motor_gains.A, &tuning->motors.A, &state->motors.A, m->theta_A);
    motor_bumpless(&state->motor_gains.B, &tuning->motors.B, &state->motors.B, m->theta_B);
    state->position_gains = gains_q;
    state->stiffness_gains = gains_S;
    state->motor_gains = tuning->motors;

    bool constant = reference.q_ref == before.q_ref && reference.S_ref == before.S_ref;
    update_rest(tracking, rest, constant, reference.q_ref - m->q, reference.S_ref - S);
    double q_c = outer_step(&gains_q, &state->position, reference.q_ref, m->q, state->correction_q,
                            dead_zone(rest, tracking->dead_zone_q));
    double S_c = outer_step(&gains_S, &state->stiffness, reference.S_ref, S, state->correction_S,
                            dead_zone(rest, tracking->dead_zone_S));
    double theta_A_ref, theta_B_ref, excess_A, excess_B;
    double S_held = allowed_stiffness(tuning, state, S_c, m);
    double q_held = clamp(q_c, tuning->envelope.q_max);
    motor_positions(d, q_held, S_held, &theta_A_ref, &theta_B_ref);
    double u_A = motor_step(&tuning->motors.A, &state->motors.A, theta_A_ref, m->theta_A, tuning->u_max,
                            rest->resting, &excess_A);
    double u_B = motor_step(&tuning->motors.B, &state->motors.B, theta_B_ref, m->theta_B, tuning->u_max,
                            rest->resting, &excess_B);

    double back_A = excess_A / tuning->motors.A.k_p / OUTER_TRACKING_TIME_S;
    double back_B = excess_B / tuning->motors.B.k_p / OUTER_TRACKING_TIME_S;
    state->correction_q = d->r_m * (back_B - back_A) / (2.0 * d->r_j) + (q_held - q_c) / OUTER_TRACKING_TIME_S;
    state->correction_S = 2.0 * (d->r_j * d->r_j) * d->k_2 * d->r_m * (-back_A - back_B)
                          + (S_held - S_c) / OUTER_TRACKING_TIME_S;
    return (Output){u_A, u_B, theta_A_ref, theta_B_ref, S, reference.q_ref, reference.S_ref};
}

/* ---- closed loop ---- */

/* Runs inputs->ticks ticks, filling `out` (ticks, COLUMNS); leaves the final states in `x` and `controller`. Returns
 * the tick at which the safety module tripped, or -1. */
int64_t simulate(const Rig *rig, const Tuning *tuning, PlantState *x, State *controller, const Inputs *inputs,
                 double *out) {
    double line[2][DELAY_SLOTS];
    Rest rest = {true, true}; /* a run starts at rest */
    for (int64_t slot = 0; slot < DELAY_SLOTS; slot++) sense(rig, x, line, slot, 0.0, 0.0);
    for (int64_t k = 0; k < inputs->ticks; k++) {
        Measurement m = sense(rig, x, line, k + DELAY_SLOTS, inputs->noise[2 * k], inputs->noise[2 * k + 1]);
        Output y = cascade_step(tuning, controller, &rest, inputs->q_ref[k], inputs->S_ref[k], &m);
        double row[COLUMNS] = {m.q,   y.S,   m.S_true,      m.theta_A,     m.theta_B,   m.F_A,       m.F_B,
                               y.u_A, y.u_B, y.theta_A_ref, y.theta_B_ref, y.q_ref_gov, y.S_ref_gov};
        for (int column = 0; column < COLUMNS; column++) out[k * COLUMNS + column] = row[column];
        double u_A = quantise(clamp(y.u_A, rig->u_max), rig->sensors.voltage_step);
        double u_B = quantise(clamp(y.u_B, rig->u_max), rig->sensors.voltage_step);
        *x = advance(&rig->plant, *x, u_A, u_B, rig->plant.joint.r_j * inputs->F_push[k]);
        if (exceeded(rig, x)) return k;
    }
    return -1;
}
