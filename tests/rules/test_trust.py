"""Rules learned off-line: the file that is shipped, what it gains, and how it was made."""

from __future__ import annotations

import json

import numpy as np
import pytest
from shapes import angles, box, sphere

from o3d_sofnn import pipeline
from o3d_sofnn.geometry import mesh_properties
from o3d_sofnn.rules.trust import EMPHASIS, INPUTS, SHIPPED, Experience, rule_inputs, shipped
from o3d_sofnn.sofnn.estimator import SOFNN
from o3d_sofnn.sofnn.rule_file import read_rules, write_rules
from o3d_sofnn.training.learning import clouds, gain, learn
from o3d_sofnn.training.lessons import lessons
from o3d_sofnn.training.shapes import SHAPES, draw


def rms(normals, truth):
    angle = angles(normals, truth)
    return np.sqrt(np.mean(np.minimum(angle, 180.0 - angle) ** 2))


def without_experience(monkeypatch, points):
    with monkeypatch.context() as patch:
        patch.setattr(pipeline, "shipped", lambda: None)
        return pipeline.estimate_normals(points)


@pytest.mark.parametrize(("noise", "most"), [(0.0, 0.6), (0.002, 0.99)])
def test_shipped_rules_make_normals_of_a_box_better(monkeypatch, noise, most):
    shape = box(6000, (1.0, 0.7, 0.4)).noisy(noise)
    before = rms(without_experience(monkeypatch, shape.points).normals, shape.normals)
    after = rms(pipeline.estimate_normals(shape.points).normals, shape.normals)
    assert after < most * before


def test_shipped_rules_leave_a_sphere_about_as_it_is(monkeypatch):
    shape = sphere(5000).noisy(0.01)
    before = rms(without_experience(monkeypatch, shape.points).normals, shape.normals)
    after = rms(pipeline.estimate_normals(shape.points).normals, shape.normals)
    assert after < 1.1 * before


def test_shipped_rules_are_few_and_in_words():
    text = json.loads(SHIPPED.read_text(encoding="utf-8"))
    assert 1 <= len(text["rules"]) == len(text["in words"]) <= 8
    assert all(words.startswith("IF residual is about") for words in text["in words"])
    assert len(shipped().network) == len(text["rules"])


@pytest.fixture(scope="module")
def found():
    return list(clouds(1, seed=3))


def test_a_short_training_finds_rules_that_help(found):
    network, error = learn(found, 3)
    assert error < 0.98
    mesh = SHAPES[5](np.random.default_rng(99))
    points, normals = draw(mesh, 6000, 0.0, 0.0, np.random.default_rng(98))
    held_out = lessons(points, normals, 1500)
    assert gain(network, [held_out]) < 0.97
    assert gain(SOFNN().restore(shipped().network), [held_out]) < 0.9


def test_training_is_repeatable(found):
    np.testing.assert_array_equal(next(clouds(1, seed=3)).inputs, found[0].inputs)
    one, other = (learn(found[:1], 1)[0] for _ in range(2))
    np.testing.assert_array_equal(one.centers_, other.centers_)


def test_training_needs_a_trial(found):
    with pytest.raises(ValueError, match="trials: expected at least 1"):
        learn(found[:1], 0)


def test_kernel_inputs_give_what_the_network_predicts():
    experience = shipped()
    shape = box(2000)
    rules = pipeline.estimate_normals(shape.points).rules
    rng = np.random.default_rng(0)
    places = rng.uniform(0.0, 1.0, (len(rules), 3))
    gates, neurons = experience.gates(rules), experience.neurons
    offset = places[:, None] - neurons[:, 0]
    firing = gates[:, :, 0] - 0.5 * ((offset * neurons[:, 1]) ** 2).sum(axis=2)
    basis = np.exp(firing - firing.max(axis=1, keepdims=True))
    said = gates[:, :, 1] + (offset * neurons[:, 2]).sum(axis=2)
    trust = (basis * said).sum(axis=1) / basis.sum(axis=1)
    inputs = np.concatenate([rule_inputs(rules), places], axis=1)
    np.testing.assert_allclose(
        trust, -EMPHASIS * SOFNN().restore(experience.network).predict(inputs), rtol=1e-9
    )


@pytest.mark.parametrize("shape", SHAPES)
def test_shapes_are_closed_and_face_outwards(shape):
    for seed in range(4):
        mesh = shape(np.random.default_rng(seed))
        assert mesh_properties.is_closed(mesh.triangles)
        assert mesh_properties.signed_volume(mesh.vertices, mesh.triangles) > 0.0
        points, normals = draw(mesh, 500, 0.01, 2.0, np.random.default_rng(seed))
        assert np.isfinite(points).all()
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-9)


@pytest.mark.parametrize("consequent", ["constant", "linear"])
def test_rules_are_written_and_read(tmp_path, consequent):
    rng = np.random.default_rng(0)
    x = rng.uniform(-1.0, 1.0, (150, 6))
    network = SOFNN(consequent=consequent, max_rules=3, adjust_steps=20).fit(x, x[:, 0] * x[:, 1])
    network.feature_names_in_ = np.array(INPUTS, dtype=object)
    write_rules(network, tmp_path / "rules.json", {})
    read = read_rules(tmp_path / "rules.json", INPUTS)
    assert Experience(read).neurons.shape == (len(read), 3, 3)
    del network.feature_names_in_
    again = SOFNN().restore(read)
    np.testing.assert_allclose(again.predict(x), network.predict(x), rtol=0.0, atol=1e-4)
    again.partial_fit(x, x[:, 0] * x[:, 1])
    assert again.score(x, x[:, 0] * x[:, 1]) > 0.5


@pytest.mark.parametrize("text", ["", "{}", "[1]", '{"inputs": ["a"], "rules": []}'])
def test_a_file_without_rules_is_refused(tmp_path, text):
    file = tmp_path / "rules.json"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=r"rules\.json: expected"):
        read_rules(file, INPUTS)


def test_rules_for_other_inputs_are_refused():
    with pytest.raises(ValueError, match="expected rules for"):
        read_rules(SHIPPED, ["curvature"])
