// Time of the motion. Draws only when something changes.

/** Calls `draw(time)` in the animation frame after `wake`, and in every frame while playing. */
export class Clock {
  constructor(duration, draw) {
    this.duration = duration;
    this.draw = draw;
    this.time = 0;
    this.speed = 1;
    this.loop = false;
    this.playing = false;
    this.frames = 0; // drawn so far
    this.request = 0;
    this.last = null; // time of the last frame, while playing
  }

  setDuration(duration) {
    this.duration = duration;
    this.time = Math.min(this.time, duration);
  }

  play() {
    if (this.time >= this.duration) this.time = 0;
    this.playing = true;
    this.last = null;
    this.wake();
  }

  pause() {
    this.playing = false;
    this.wake();
  }

  toggle() {
    if (this.playing) this.pause();
    else this.play();
  }

  seek(time) {
    this.time = Math.min(Math.max(time, 0), this.duration);
    this.wake();
  }

  wake() {
    if (!this.request) this.request = requestAnimationFrame((now) => this.frame(now));
  }

  frame(now) {
    this.request = 0;
    if (this.playing) this.advance(now);
    this.draw(this.time);
    this.frames += 1;
    if (this.playing) this.wake();
  }

  advance(now) {
    if (this.last !== null) this.time += (this.speed * (now - this.last)) / 1000;
    this.last = now;
    if (this.time < this.duration) return;
    this.time = this.loop ? 0 : this.duration;
    this.playing = this.loop;
  }
}
