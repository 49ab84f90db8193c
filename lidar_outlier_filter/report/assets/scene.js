// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0

// The points in 3-D. The vertex shader unpacks the four words of a point; a slider changes one uniform.

import {
  BufferAttribute, BufferGeometry, DataTexture, GLSL3, NearestFilter, OrbitControls, OrthographicCamera,
  PerspectiveCamera, Points, RawShaderMaterial, RGBAFormat, Scene, Sphere, Vector3, WebGLRenderer,
} from 'three';
import { isRejected, isShown, measure, position } from 'data';
import { FRAGMENT, MARK_FRAGMENT, MARK_VERTEX, Slices, VERTEX, evenOrder, partition, ranges } from 'shaders';

const SETTLED = 180; // milliseconds without a change before the rest of the points follows
const SOFTWARE = /swiftshader|llvmpipe|software|basic render/i;

export class View {
  // Throws where there is no WebGL 2.
  constructor(canvas, data) {
    this.canvas = canvas;
    this.data = data;
    const gl = canvas.getContext('webgl2', { antialias: false, powerPreference: 'high-performance', preserveDrawingBuffer: true });
    if (!gl) throw new Error('no WebGL 2');
    this.renderer = new WebGLRenderer({ canvas, context: gl, antialias: false });
    this.renderer.debug.checkShaderErrors = false;
    const info = gl.getExtension('WEBGL_debug_renderer_info');
    const name = info ? gl.getParameter(info.UNMASKED_RENDERER_WEBGL) : '';
    this.software = SOFTWARE.test(name);
    this.ratio = this.software ? 1 : Math.min(devicePixelRatio, 2); // pixels of the canvas ÷ those of CSS
    this.slices = new Slices(this.software ? 250000 : 4000000);
    this.scene = new Scene();
    this.frames = { first: 0, last: data.frames.length - 1 };
    Object.assign(this, measure(data.frames));
    this.shared = this.uniforms();
    this.objects = data.frames.map((frame) => this.object(frame));
    this.marks = [this.mark(9), this.mark(4)];
    this.perspective = new PerspectiveCamera(50, 1, this.radius / 5000, this.radius * 20);
    this.flat = new OrthographicCamera(-1, 1, 1, -1, -this.radius * 10, this.radius * 20);
    for (const camera of [this.perspective, this.flat]) camera.up.set(0, 0, 1);
    this.camera = this.perspective;
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.addEventListener('change', () => this.draw());
    this.controls.zoomToCursor = true;
    this.listeners = [];
    this.pending = false;
    this.resize();
    new ResizeObserver(() => this.resize()).observe(canvas.parentElement);
  }

  uniforms() {
    const values = {
      bit: 1, nearBits: 0, hidden: 0, stepNumber: 0, mode: 0, show: 0, size: 2 * this.ratio, heights: this.heights,
      low: new Vector3(), high: new Vector3(), rejectedColour: new Vector3(),
      nearColour: new Vector3(), missedColour: new Vector3(), lostColour: new Vector3(),
      palette: null,
    };
    return Object.fromEntries(Object.entries(values).map(([name, value]) => [name, { value }]));
  }

  object(frame) {
    const geometry = new BufferGeometry();
    geometry.setAttribute('position', new BufferAttribute(frame.words, 4));
    geometry.setIndex(new BufferAttribute(evenOrder(frame), 1));
    const near = frame.origin.map((value, a) => value - this.centre[a]);
    const size = frame.step.map((step) => step * 0x1fffff);
    const middle = new Vector3(...near.map((value, a) => value + size[a] / 2));
    geometry.boundingSphere = new Sphere(middle, Math.hypot(...size) / 2 + 0.01);
    const material = new RawShaderMaterial({
      glslVersion: GLSL3, vertexShader: VERTEX, fragmentShader: FRAGMENT,
      uniforms: {
        ...this.shared,
        origin: { value: new Vector3(...near) },
        unit: { value: new Vector3(...frame.step) },
      },
    });
    const points = new Points(geometry, [material]);
    points.matrixAutoUpdate = false;
    points.userData = { frame, bit: 0, rejected: 0 };
    this.scene.add(points);
    return points;
  }

  // The newest frame replaces the oldest, where one is too old.
  push(frame) {
    this.data.frames.push(frame);
    this.objects.push(this.object(frame));
  }

  shift() {
    this.data.frames.shift();
    const object = this.objects.shift();
    this.scene.remove(object);
    object.geometry.dispose();
    object.material[0].dispose();
  }

  mark(size) {
    const material = new RawShaderMaterial({
      glslVersion: GLSL3, vertexShader: MARK_VERTEX, fragmentShader: MARK_FRAGMENT,
      uniforms: { colour: { value: new Vector3() }, size: { value: size * this.ratio } },
    });
    const points = new Points(new BufferGeometry(), material);
    points.frustumCulled = false;
    points.visible = false;
    points.renderOrder = 1;
    this.scene.add(points);
    return points;
  }

  // Rings around points: 0 the neighbours of the chosen one, 1 its line.
  setMarks(which, frame, indices) {
    const object = this.marks[which];
    object.geometry.dispose();
    object.geometry = new BufferGeometry();
    const there = [0, 0, 0];
    const flat = new Float32Array(3 * indices.length);
    indices.forEach((i, k) => {
      position(frame, i, there);
      for (let a = 0; a < 3; a += 1) flat[3 * k + a] = there[a] - this.centre[a];
    });
    object.geometry.setAttribute('position', new BufferAttribute(flat, 3));
    object.visible = indices.length > 0;
    this.draw();
  }

  setColours(colours) {
    const shared = this.shared;
    for (const name of ['low', 'high', 'rejectedColour', 'nearColour', 'missedColour', 'lostColour']) {
      shared[name].value.set(...colours[name]);
    }
    shared.palette.value?.dispose();
    const texture = new DataTexture(colours.palette, 256, 4, RGBAFormat);
    texture.minFilter = texture.magFilter = NearestFilter;
    texture.needsUpdate = true;
    shared.palette.value = texture;
    this.marks.forEach((mark, i) => mark.material.uniforms.colour.value.set(...colours.marks[i]));
    this.renderer.setClearColor(colours.ground, 1);
    this.draw();
  }

  // Colour each point by its columns; `write` puts the red, green and blue of a point into an array.
  setTints(write) {
    for (const { geometry, userData } of this.objects) {
      const tints = new Uint8Array(4 * userData.frame.count);
      for (let i = 0; i < userData.frame.count; i += 1) write(userData.frame.columns, i, tints);
      geometry.setAttribute('tint', new BufferAttribute(tints, 4, true));
    }
    this.draw();
  }

  set(name, value) {
    this.shared[name].value = value;
    this.draw();
  }

  setFrames(first, last) {
    this.frames = { first, last };
    this.objects.forEach((object, i) => { object.visible = i >= first && i <= last; });
    this.draw();
  }

  resize() {
    const box = this.canvas.parentElement.getBoundingClientRect();
    if (!box.width || !box.height) return;
    this.renderer.setPixelRatio(this.ratio);
    this.renderer.setSize(box.width, box.height, false);
    this.perspective.aspect = box.width / box.height;
    this.perspective.updateProjectionMatrix();
    const half = this.flat.top;
    this.flat.left = -half * this.perspective.aspect;
    this.flat.right = half * this.perspective.aspect;
    this.flat.updateProjectionMatrix();
    this.draw();
  }

  // 'orbit', 'top' or 'side'
  setView(view) {
    const tall = Math.max(this.extent[1], this.extent[0] / this.perspective.aspect) / 2;
    const half = view === 'top' ? tall : Math.max(this.extent[2], this.extent[0] / this.perspective.aspect) / 2;
    this.camera = view === 'orbit' ? this.perspective : this.flat;
    this.camera.zoom = 1;
    if (view === 'orbit') {
      const away = this.radius * 1.1;
      this.camera.position.set(-0.62 * away, -0.62 * away, 0.48 * away);
    } else {
      this.flat.top = half * 1.14;
      this.flat.bottom = -this.flat.top;
      this.camera.position.set(0, view === 'top' ? -1e-3 : -this.radius * 2, view === 'top' ? this.radius * 2 : 0);
      this.resize();
    }
    this.controls.object = this.camera;
    this.controls.target.set(0, 0, 0);
    this.controls.update();
    this.camera.updateProjectionMatrix();
    this.draw();
  }

  flyTo(where, size) {
    const target = new Vector3(...where.map((value, a) => value - this.centre[a]));
    const away = Math.min(Math.max(2.2 * size, 5), 2 * this.radius);
    const back = this.camera.position.clone().sub(this.controls.target).normalize();
    if (this.camera === this.flat) {
      this.flat.zoom = this.flat.top / (away / 2);
      this.camera.position.copy(target).addScaledVector(back, this.radius * 2);
    } else {
      this.camera.position.copy(target).addScaledVector(back, away);
    }
    this.controls.target.copy(target);
    this.camera.updateProjectionMatrix();
    this.controls.update();
    this.draw();
  }

  // Turn by angles, rad.
  turn(right, up) {
    const offset = this.camera.position.clone().sub(this.controls.target);
    const flat = Math.hypot(offset.x, offset.y);
    const angle = Math.atan2(offset.y, offset.x) + right;
    const slope = Math.min(Math.max(Math.atan2(offset.z, flat) + up, -1.56), 1.56);
    const away = offset.length();
    offset.set(Math.cos(angle) * Math.cos(slope), Math.sin(angle) * Math.cos(slope), Math.sin(slope));
    this.camera.position.copy(this.controls.target).addScaledVector(offset, away);
    this.controls.update();
    this.draw();
  }

  // Fly: ahead, to the right and up, parts of the distance to the target.
  fly(ahead, right, up) {
    const offset = this.controls.target.clone().sub(this.camera.position);
    const away = this.camera === this.flat ? this.flat.top / this.flat.zoom : offset.length();
    const forward = offset.normalize();
    const aside = new Vector3().crossVectors(forward, this.camera.up).normalize();
    const move = forward.multiplyScalar(ahead * away).addScaledVector(aside, right * away);
    move.z += up * away;
    this.camera.position.add(move);
    this.controls.target.add(move);
    this.controls.update();
    this.draw();
  }

  zoom(factor) {
    if (this.camera === this.flat) {
      this.flat.zoom *= factor;
      this.flat.updateProjectionMatrix();
    } else {
      const offset = this.camera.position.clone().sub(this.controls.target).divideScalar(factor);
      this.camera.position.copy(this.controls.target).add(offset);
    }
    this.controls.update();
    this.draw();
  }

  get full() {
    return this.slices.done;
  }

  // A new picture: of some points at once, of all of them when nothing has changed for a while.
  draw() {
    this.slices.restart();
    clearTimeout(this.settling);
    this.soon();
  }

  soon() {
    if (this.pending) return;
    this.pending = true;
    requestAnimationFrame(() => this.render());
  }

  render() {
    this.pending = false;
    const begins = !this.slices.begun;
    const visible = this.objects.filter((object) => object.visible);
    if (begins) visible.forEach((object) => this.sort(object));
    const all = visible.reduce((sum, { userData }) => sum + userData.frame.count, 0);
    const rejected = visible.reduce((sum, { userData }) => sum + userData.rejected, 0);
    const slice = this.slices.next(rejected, all - rejected);
    for (const { geometry, userData } of visible) {
      geometry.clearGroups();
      for (const [first, count] of ranges(userData.frame, userData.rejected, slice)) geometry.addGroup(first, count, 0);
    }
    this.renderer.autoClear = begins;
    this.renderer.render(this.scene, this.camera);
    // The pause begins behind the picture, which may take longer itself.
    clearTimeout(this.settling);
    if (!this.full) this.settling = setTimeout(() => this.soon(), begins ? SETTLED : 0);
    const [, [some, others]] = slice;
    for (const listener of this.listeners) listener(Math.ceil(some * rejected + others * (all - rejected)), all);
  }

  // The rejected points of a frame first, if that is not their order already.
  sort({ geometry, userData }) {
    const bit = this.shared.bit.value;
    if (userData.bit === bit) return;
    userData.bit = bit;
    userData.rejected = partition(userData.frame, geometry.index.array, bit);
    geometry.index.clearUpdateRanges();
    geometry.index.addUpdateRange(0, userData.frame.marked);
    geometry.index.needsUpdate = true;
  }

  // Wait until the picture is there: drawing only asks for it.
  finish() {
    const gl = this.renderer.getContext();
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
  }

  // Where a point is on the screen, CSS pixels; null: behind the eye.
  project(where) {
    const v = new Vector3(...where.map((value, a) => value - this.centre[a])).project(this.camera);
    if (v.z < -1 || v.z > 1) return null;
    const box = this.canvas.getBoundingClientRect();
    return [((v.x + 1) / 2) * box.width, ((1 - v.y) / 2) * box.height];
  }

  // The point at a pixel of the canvas, CSS pixels: the rejected before others, then the nearest.
  // Of those only that are shown, see `isShown`.
  pick(x, y, state) {
    let best = null;
    let least = Infinity;
    this.seen(state, (frame, index, [u, v, depth]) => {
      const d = (u - x) ** 2 + (v - y) ** 2;
      if (d > 100) return;
      const cost = d + 20 * depth - (isRejected(this.data.frames[frame], index, state.bit) ? 150 : 0);
      if (cost < least) { least = cost; best = { frame, index }; }
    });
    return best;
  }

  // Tell of each point that is shown and in front of the eye: its frame, its index, and where it is,
  // CSS pixels of the canvas and depth. The place is the same array each time.
  seen(state, tell) {
    const box = this.canvas.getBoundingClientRect();
    this.camera.updateMatrixWorld();
    const m = this.camera.projectionMatrix.clone().multiply(this.camera.matrixWorldInverse).elements;
    const there = [0, 0, 0];
    const place = [0, 0, 0];
    for (let f = this.frames.first; f <= this.frames.last; f += 1) {
      const frame = this.data.frames[f];
      for (let i = 0; i < frame.count; i += 1) {
        position(frame, i, there);
        const px = there[0] - this.centre[0];
        const py = there[1] - this.centre[1];
        const pz = there[2] - this.centre[2];
        const w = m[3] * px + m[7] * py + m[11] * pz + m[15];
        if (w <= 0 || !isShown(frame, i, state)) continue;
        place[0] = ((m[0] * px + m[4] * py + m[8] * pz + m[12]) / w + 1) * 0.5 * box.width;
        place[1] = (1 - (m[1] * px + m[5] * py + m[9] * pz + m[13]) / w) * 0.5 * box.height;
        place[2] = ((m[2] * px + m[6] * py + m[10] * pz + m[14]) / w + 1) / 2;
        tell(f, i, place);
      }
    }
  }

  // Metres that a CSS pixel has, at the target.
  get metresPerPixel() {
    const height = this.canvas.getBoundingClientRect().height || 1;
    if (this.camera === this.flat) return (2 * this.flat.top) / this.flat.zoom / height;
    const away = this.camera.position.distanceTo(this.controls.target);
    return (2 * away * Math.tan((this.perspective.fov * Math.PI) / 360)) / height;
  }

  // Position of the eye and its target, metres from the middle; and the zoom of a flat view.
  get pose() {
    return [...this.camera.position.toArray(), ...this.controls.target.toArray(), this.camera.zoom];
  }

  set pose(numbers) {
    this.camera.position.set(...numbers.slice(0, 3));
    this.controls.target.set(...numbers.slice(3, 6));
    this.camera.zoom = numbers[6];
    this.camera.updateProjectionMatrix();
    this.controls.update();
    this.draw();
  }
}
