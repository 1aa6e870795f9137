"""The two solutions: what the data say is found, what they do not say stays, and the spread is what it claims."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from scipy.stats import chi2

from body.reference import leg_regressor as pinocchio_regressor
from identify.leg_runs import hyq, leg_regressor, other_hyq, parameters_of, rich_motion, told
from stadera.body import JointMotion, JointTorqueRegressor, Rows
from stadera.identify.observability import Identifiability, observability
from stadera.identify.prior import Prior, robot_prior
from stadera.identify.solutions import Estimate, consistent_solution, null_space_solution
from stadera.inertia import InertialParameters
from stadera.information import Information
from stadera.lab.plant.leg import perturbed
from stadera.robot import JointDynamics, Robot

SOLUTIONS = [null_space_solution, consistent_solution]
DRIVE = JointDynamics(armature=0.03, viscous=0.6, coulomb=1.2, offset=-0.5)


def true_leg(friction: bool = False) -> Robot:
    """Another HyQ, its masses the model's."""
    robot = other_hyq()
    return robot.with_dynamics(dict.fromkeys(robot.tree.joints, DRIVE)) if friction else robot


def solved(solve, robot: Robot | None = None, friction: bool = False, **telling) -> tuple[Estimate, dict[str, float]]:
    """The estimate with the model's HyQ for a prior, and the truth."""
    regressor = leg_regressor(hyq(), friction)
    truth = parameters_of(robot or true_leg(friction), regressor.columns)
    information = told(truth, regressor, **telling)
    return solve(information, robot_prior(hyq(), regressor.columns)), truth


def verdict_mask(estimate: Estimate, verdict: Identifiability) -> np.ndarray:
    return np.array([v is verdict for v in estimate.observability.verdicts()])


@pytest.mark.parametrize("solve", SOLUTIONS)
@pytest.mark.parametrize("friction", [False, True])
def test_observables_are_recovered(solve, friction: bool) -> None:
    """Parameters and combinations that noiseless data determine, to 1e-6 of their scale; the rest fits the data too."""
    estimate, truth = solved(solve, friction=friction)
    values = np.array(list(truth.values()))
    known = verdict_mask(estimate, Identifiability.OBSERVABLE)
    assert known.sum() >= 3
    np.testing.assert_allclose(((estimate.values - values) / estimate.prior.scales)[known], 0.0, atol=1e-6)
    by_name = estimate.by_name()
    for combination in estimate.observability.combinations():
        size = sum(abs(f) * estimate.prior.scales[estimate.columns.index(n)] for n, f in combination.terms)
        assert abs(combination.of(by_name) - combination.of(truth)) < 1e-6 * size
    torque = leg_regressor(hyq(), friction).predict(rich_motion(50, seed=9), truth)
    found = leg_regressor(hyq(), friction).predict(rich_motion(50, seed=9), by_name)
    np.testing.assert_allclose(found, torque, atol=1e-6 * np.abs(torque).max())


@pytest.mark.parametrize("solve", SOLUTIONS)
@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_masses_stay_at_cad(solve, noise: float) -> None:
    estimate, _ = solved(solve, noise=noise)
    for link in estimate.prior.links:
        assert estimate.inertia(link).mass == pytest.approx(hyq().inertias[link].mass, rel=1e-9)
    assert estimate.held == tuple(f"{link}.m" for link in estimate.prior.links)
    stds = np.sqrt(np.diag(estimate.covariance))
    for link in estimate.prior.links:  # held for want of knowledge, not known
        k = estimate.prior.block(link).start
        assert stds[k] == pytest.approx(estimate.prior.scales[k], rel=0.35)


def test_unobservable_parameters_are_exactly_cad() -> None:
    estimate, _ = solved(null_space_solution)
    silent = verdict_mask(estimate, Identifiability.UNOBSERVABLE)
    assert silent.any()
    np.testing.assert_array_equal(estimate.values[silent], estimate.prior.values[silent])


@pytest.mark.parametrize("seed", range(3))
def test_null_space_is_eq_5(seed: int) -> None:
    """φ = Y⁺τ + N (φ_CAD - Y⁺τ) with dense pseudo-inverses of Pinocchio's regressor, in units of the prior widths.

    The metric that puts masses first is the limit of one in which they weigh ever more; here they are taken out: the
    same formula on the other parameters with the masses at CAD.
    """
    rng = np.random.default_rng(seed)
    regressor, motion = leg_regressor(hyq()), rich_motion(60, seed)
    prior = robot_prior(hyq(), regressor.columns)
    torque = rng.normal(size=(60, 3)) + regressor.predict(motion, parameters_of(true_leg(), regressor.columns))
    Y = pinocchio_regressor(hyq().leg_tree("RH"), motion, np.array([0.0, 0.0, 1.0])).reshape(-1, 30)
    others = [k for k, c in enumerate(regressor.columns) if not c.endswith(".m")]
    masses = [k for k in range(30) if k not in others]
    w, cad = prior.scales[others], prior.values[others]
    pseudo = np.linalg.pinv(Y[:, others] * w, rcond=1e-9)
    N = np.eye(27) - pseudo @ (Y[:, others] * w)
    right = torque.reshape(-1) - Y[:, masses] @ prior.values[masses]
    phi = prior.values.copy()
    phi[others] = w * (pseudo @ right + N @ (cad / w - pseudo @ right))
    found = null_space_solution(Information.of(regressor.rows(motion, torque, std=1e-6), regressor.columns), prior)
    np.testing.assert_allclose((found.values - phi) / prior.scales, 0.0, atol=1e-6)


def test_nothing_told_is_the_prior() -> None:
    columns = leg_regressor(hyq(), friction=True).columns
    prior = robot_prior(hyq(), columns)
    for solve in SOLUTIONS:
        estimate = solve(Information.empty(columns), prior)
        np.testing.assert_allclose(estimate.values, prior.values, atol=1e-15)
        np.testing.assert_allclose(np.diag(estimate.covariance), prior.scales**2, rtol=1e-9)
        assert estimate.is_physical
        assert estimate.observability.rank == 0


@pytest.mark.parametrize("seed", range(4))
def test_consistent_is_physical_where_least_squares_is_not(seed: int) -> None:
    """Noise, and joints without friction or rotor inertia, push a free solution out of the physical set."""
    robot = other_hyq().with_dynamics(dict.fromkeys(hyq().tree.joints, JointDynamics()))
    told_so = {"robot": robot, "friction": True, "noise": 8.0, "motion": rich_motion(100, seed)}
    free, _ = solved(null_space_solution, **told_so, rng=np.random.default_rng(seed))
    estimate, _ = solved(consistent_solution, **told_so, rng=np.random.default_rng(seed))
    assert not free.is_physical
    assert estimate.is_physical
    for link in estimate.prior.links:
        assert np.linalg.eigvalsh(estimate.inertia(link).pseudo_inertia).min() > 0
        np.linalg.cholesky(estimate.inertia(link).pseudo_inertia)
    for name, value in estimate.by_name().items():
        if name.endswith((".armature", ".viscous", ".coulomb")):
            assert value >= 0.0


def test_consistent_is_the_optimum_of_its_problem() -> None:
    """No feasible body nearby costs less, wherever one looks."""
    robot = other_hyq().with_dynamics(dict.fromkeys(hyq().tree.joints, JointDynamics()))
    regressor = leg_regressor(hyq(), friction=True)
    prior = robot_prior(hyq(), regressor.columns)
    information = told(parameters_of(robot, regressor.columns), regressor, noise=8.0, motion=rich_motion(100))
    estimate = consistent_solution(information, prior)

    def cost(values: np.ndarray) -> float:
        x = np.linalg.solve(prior.root, values - prior.values)
        return information.residual_squared(values) + float(x @ x)

    def feasible(values: np.ndarray) -> bool:
        signed = [
            v for c, v in zip(prior.columns, values, strict=True) if c.endswith(("armature", "viscous", "coulomb"))
        ]
        links = [
            np.linalg.eigvalsh(
                InertialParameters(values[prior.block(link)]).pseudo_inertia
                - 1e-3 * hyq().inertias[link].pseudo_inertia
            ).min()
            for link in prior.links
        ]
        return min(signed) >= 0 and min(links) >= -1e-12

    best = cost(estimate.values)
    rng = np.random.default_rng(0)
    tried = 0
    free = np.setdiff1d(np.arange(len(prior.columns)), list(prior.mass_coordinates.values()))
    for size in (1e-1, 1e-2, 1e-3):
        for _ in range(200):
            x = np.zeros(len(prior.columns))
            x[free] = rng.normal(0.0, size, len(free))
            candidate = estimate.values + prior.root @ x
            if feasible(candidate):
                tried += 1
                assert cost(candidate) > best - 1e-5 * abs(best)
    # towards feasible bodies: the way to any of them is feasible, for the set is convex
    for seed in range(50):
        rng = np.random.default_rng(seed)
        far = prior.values.copy()
        for link in prior.links:
            D = rng.normal(0.0, 0.2, (4, 4))
            D = D + D.T
            D[3, 3] = 0.0
            U = np.linalg.cholesky(hyq().inertias[link].pseudo_inertia[::-1, ::-1])[::-1, ::-1]
            far[prior.block(link)] = InertialParameters.from_pseudo_inertia(U @ (np.eye(4) + D) @ U.T).vector
        if feasible(far):
            tried += 1
            for share in (1e-3, 1e-2, 0.1, 1.0):
                assert cost(estimate.values + share * (far - estimate.values)) > best - 1e-5 * abs(best)
    assert tried > 20


def test_consistent_is_the_null_space_one_where_data_are_rich() -> None:
    """Inside the physical set and with data that outweigh the prior, both find the same combinations."""
    there, _ = solved(null_space_solution, friction=True, noise=1e-3)
    again, _ = solved(consistent_solution, friction=True, noise=1e-3)
    assert again.is_physical
    for combination in there.observability.combinations():
        size = sum(abs(f) * there.prior.scales[there.columns.index(n)] for n, f in combination.terms)
        assert abs(combination.of(there.by_name()) - combination.of(again.by_name())) < 2e-3 * size


# -- invariance ---------------------------------------------------------------------------------------------------
def reframed(robot: Robot, seed: int) -> tuple[Robot, dict[str, tuple[np.ndarray, np.ndarray]]]:
    """The same robot with other frames on the RH leg's links: turned any way, and moved along their joints' axes.

    Also the way back, r_old = R r_new + p for each link.
    """
    rng = np.random.default_rng(seed)
    tree, leg = robot.tree, robot.leg("RH")
    rotations, translations, axes = tree.rotations.copy(), tree.translations.copy(), tree.axes.copy()
    inertias, back = dict(robot.inertias), {}
    for link, joint in zip(leg.links, leg.joints, strict=True):
        i = tree.joints.index(joint)
        R, p = pin.Quaternion(rng.normal(size=4)).normalized().matrix(), rng.uniform(-0.2, 0.2) * tree.axes[i]
        back[link] = (R, p)
        inertias[link] = robot.inertias[link].transformed(R.T, -R.T @ p)
        # the joint turns about the same line: parent T old(q) = parent T old · Rot(axis, q)
        rotations[i], translations[i] = tree.rotations[i] @ R, tree.translations[i] + tree.rotations[i] @ p
        axes[i] = R.T @ tree.axes[i]
        for k in (k for k, parent in enumerate(tree.parents) if parent == i + 1):
            rotations[k], translations[k] = R.T @ tree.rotations[k], R.T @ (tree.translations[k] - p)
            tree = replace(tree, rotations=rotations.copy(), translations=translations.copy(), axes=axes.copy())
    tree = replace(tree, rotations=rotations, translations=translations, axes=axes)
    return replace(robot, tree=tree, inertias=inertias), back


@pytest.mark.parametrize("noise", [1e-3, 1.0, 8.0])
def test_consistent_does_not_depend_on_link_frames(noise: float) -> None:
    motion = rich_motion(100)
    here = JointTorqueRegressor(hyq().leg_tree("RH"))
    torque = here.predict(motion, parameters_of(true_leg(), here.columns))
    torque = torque + np.random.default_rng(2).normal(0.0, noise, torque.shape)
    robot, back = reframed(hyq(), seed=4)
    there = JointTorqueRegressor(robot.leg_tree("RH"))
    np.testing.assert_allclose(
        there.predict(motion, parameters_of(robot, there.columns)),
        here.predict(motion, parameters_of(hyq(), here.columns)),
        atol=1e-10,
    )
    found = [
        consistent_solution(
            Information.of(regressor.rows(motion, torque, std=noise), regressor.columns),
            robot_prior(model, regressor.columns),
        )
        for regressor, model in ((here, hyq()), (there, robot))
    ]
    for link in hyq().leg("RH").links:
        moved = found[1].inertia(link).transformed(*back[link])
        width = found[0].prior.scales[found[0].prior.block(link)]
        np.testing.assert_allclose((moved.vector - found[0].inertia(link).vector) / width, 0.0, atol=2e-5)


@pytest.mark.parametrize("solve", SOLUTIONS)
@pytest.mark.parametrize("noise", [1e-3, 8.0])
def test_does_not_depend_on_units(solve, noise: float) -> None:
    """Grams and millimetres: the same leg."""
    regressor = leg_regressor(hyq(), friction=True)
    prior = robot_prior(hyq(), regressor.columns)
    information = told(parameters_of(true_leg(True), regressor.columns), regressor, noise=noise)
    unit = np.concatenate((np.tile(1e3 * 1e3 ** np.array([0, 1, 1, 1, 2, 2, 2, 2, 2, 2.0]), 3), np.full(12, 1e9)))
    other = replace(prior, values=prior.values * unit, root=prior.root * unit[:, None])
    in_si = solve(information, prior)
    scaled = solve(replace(information, R=information.R / unit), other)
    np.testing.assert_allclose((scaled.values / unit - in_si.values) / prior.scales, 0.0, atol=2e-5)
    spread = np.sqrt(np.diag(in_si.covariance))
    np.testing.assert_allclose(np.sqrt(np.diag(scaled.covariance)) / unit, spread, rtol=1e-4)


@pytest.mark.parametrize("solve", SOLUTIONS)
def test_order_of_columns_does_not_matter(solve) -> None:
    regressor = leg_regressor(hyq(), friction=True)
    truth = parameters_of(true_leg(True), regressor.columns)
    c = regressor.columns
    turned = (*c[40:42], *c[20:30], *c[30:40], *c[0:10], *c[10:20])
    motion = rich_motion()
    rows = list(regressor.rows(motion, regressor.predict(motion, truth), std=0.1))
    here = solve(Information.of(rows, c), robot_prior(hyq(), c))
    for information in (Information.of(rows, turned), Information.of(rows, c)):
        there = solve(information, robot_prior(hyq(), turned)).by_name()
        for name, value, width in zip(c, here.values, here.prior.scales, strict=True):
            assert there[name] == pytest.approx(value, abs=1e-5 * width)


# -- spread -------------------------------------------------------------------------------------------------------
def draws(prior: Prior, regressor: JointTorqueRegressor, motion: JointMotion, noise: float, count: int, vary: bool):
    """Truths (the prior's own draws, or CAD) and what noisy torques of each say."""
    for seed in range(count):
        rng = np.random.default_rng(seed)
        x = 0.2 * rng.normal(size=len(prior.columns)) if vary else np.zeros(len(prior.columns))
        values = prior.values + prior.root @ x
        truth = dict(zip(prior.columns, values.tolist(), strict=True))
        yield values, told(truth, regressor, noise=noise, rng=rng, motion=motion)


@pytest.mark.parametrize("solve", SOLUTIONS)
def test_spread_of_combinations_is_what_it_claims(solve) -> None:
    """NEES of all identifiable combinations over 120 draws of truth and noise lies in chi-square's 99.9 % band."""
    regressor, motion, count = leg_regressor(hyq()), rich_motion(200), 120
    prior = robot_prior(hyq(), regressor.columns)
    structure = told(parameters_of(hyq(), regressor.columns), regressor, motion=motion)
    found = observability(structure, prior)
    G = np.array([[dict(c.terms).get(n, 0.0) for n in prior.columns] for c in found.combinations()])
    total = 0.0
    for values, information in draws(prior, regressor, motion, 0.005, count, vary=True):
        estimate = solve(information, prior)
        error = G @ (estimate.values - values)
        total += error @ np.linalg.solve(G @ estimate.covariance @ G.T, error)
        assert estimate.observability.rank == 17
    low, high = chi2.ppf([0.0005, 0.9995], 17 * count)
    assert low < total < high


def test_spread_of_every_parameter_is_what_it_claims() -> None:
    """Truths drawn from the prior itself, masses too: NEES of all parameters, the held masses among them."""
    regressor, motion, count = leg_regressor(hyq()), rich_motion(60), 150
    prior = robot_prior(hyq(), regressor.columns)
    narrow = replace(prior, root=0.2 * prior.root, coordinates={k: 0.2 * v for k, v in prior.coordinates.items()})
    total = 0.0
    for values, information in draws(prior, regressor, motion, 1.0, count, vary=True):
        estimate = consistent_solution(information, narrow)
        error = (estimate.values - values) / narrow.scales
        P = estimate.covariance / np.outer(narrow.scales, narrow.scales)
        total += error @ np.linalg.solve(P, error)
    low, high = chi2.ppf([0.0005, 0.9995], 30 * count)
    assert low < total < high


def test_covariance_is_that_of_the_dense_posterior() -> None:
    """(Yᵀ Y / σ² + S⁻ᵀ S⁻¹)⁻¹ where no mass is held, here because the masses are told by rows of their own."""
    regressor, motion = leg_regressor(hyq()), rich_motion(80)
    prior = robot_prior(hyq(), regressor.columns)
    weighed = [
        Rows((f"{link}.m",), np.ones((1, 1)), np.array([hyq().inertias[link].mass]), 1e-3) for link in prior.links
    ]
    information = told(parameters_of(true_leg(), prior.columns), regressor, noise=0.5, motion=motion)
    information = information.merge(Information.of(weighed, information.names))
    estimate = consistent_solution(information, prior)
    assert estimate.held == ()
    Y = pinocchio_regressor(hyq().leg_tree("RH"), motion, np.array([0.0, 0.0, 1.0])).reshape(-1, 30) / 0.5
    W = np.zeros((3, 30))
    W[range(3), [0, 10, 20]] = 1e3
    inverse = np.linalg.inv(prior.root)
    expected = np.linalg.inv(Y.T @ Y + W.T @ W + inverse.T @ inverse)
    scale = np.outer(prior.scales, prior.scales)
    np.testing.assert_allclose(estimate.covariance / scale, expected / scale, atol=1e-7)


@pytest.mark.parametrize("solve", SOLUTIONS)
def test_information_on_more_than_is_asked_for(solve) -> None:
    """Columns that the prior does not name are left free."""
    regressor = leg_regressor(hyq(), friction=True)
    truth = parameters_of(true_leg(True), regressor.columns)
    information = told(truth, regressor)
    inertial = regressor.columns[:30]
    estimate = solve(information, robot_prior(hyq(), inertial))
    assert estimate.columns == inertial
    known = verdict_mask(estimate, Identifiability.OBSERVABLE)
    expected = np.array([truth[c] for c in inertial])
    np.testing.assert_allclose(((estimate.values - expected) / estimate.prior.scales)[known], 0.0, atol=1e-5)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("noise", [0.0, 1e-2])
def test_data_that_contradict_consistency_have_an_answer(seed: int, noise: float) -> None:
    """Near noiseless torques of a leg that cannot exist, and of a drive that helps: physical, and closer than CAD."""
    robot = perturbed(hyq(), "RH", np.random.default_rng(seed))
    regressor = leg_regressor(hyq(), friction=True)
    truth = parameters_of(robot, regressor.columns) | {"rh_hfe_joint.armature": -0.3}
    information = told(truth, regressor, noise=noise, motion=rich_motion(200, seed))
    prior = robot_prior(hyq(), regressor.columns)
    estimate = consistent_solution(information, prior)
    assert estimate.is_physical
    assert information.residual_squared(estimate.values) < information.residual_squared(prior.values)


@pytest.mark.parametrize("noise", [0.0, 1e-6, 1e-3, 1.0])
def test_a_truth_on_the_border_of_the_consistent_set(noise: float) -> None:
    """The model's own leg, whose joints have neither friction nor rotor inertia: rounding alone crosses the border."""
    robot = hyq().with_dynamics(dict.fromkeys(hyq().tree.joints, JointDynamics()))
    for seed in range(3):
        estimate, truth = solved(
            consistent_solution, robot, friction=True, noise=noise, motion=rich_motion(100, seed), std=noise or 1e-9
        )
        assert estimate.is_physical
        gap = np.abs(estimate.values - np.array(list(truth.values())))
        std = np.sqrt(np.diag(estimate.covariance))
        assert (gap <= 5.0 * std * (noise > 0) + 1e-3 * estimate.prior.scales).all()
