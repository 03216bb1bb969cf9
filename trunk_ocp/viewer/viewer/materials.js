// Materials of three.js, and how they fade.

/* global THREE */

const CLEAR = 0.13; // opacity of the other muscles while one is selected
const GLASS = 0.3; // of outer muscles through which one sees the inner ones
const SKIN = 0x8f8780;

export function solidMaterial(color) {
  return new THREE.MeshLambertMaterial({ color });
}

/** A solid with light edges, so that neighbors of one color can be distinguished. */
export function linedMaterial() {
  const material = solidMaterial(0xffffff);
  material.onBeforeCompile = (shader) => {
    shader.vertexShader = shader.vertexShader.replace("void main() {", `attribute float rim;
      varying float vRim;
      void main() {
        vRim = rim;`);
    shader.fragmentShader = shader.fragmentShader
      .replace("void main() {", "varying float vRim;\nvoid main() {")
      .replace("#include <color_fragment>", `#include <color_fragment>
        float wide = fwidth(vRim);
        float line = smoothstep(1.0 - 1.2 * wide, 1.0 - 0.4 * wide, vRim);
        diffuseColor.rgb = mix(diffuseColor.rgb, vec3(0.9), 0.45 * line);`);
  };
  return material;
}

export function skinMaterial() {
  const glass = { transparent: true, opacity: 0.35, depthWrite: false };
  return new THREE.MeshLambertMaterial({ color: SKIN, ...glass });
}

/** Make a material opaque, or let others show through it: "clear" more than "glass". */
export function fade(material, how) {
  const opacity = { opaque: 1, glass: GLASS, clear: CLEAR }[how];
  if (material.opacity === opacity) return;
  material.opacity = opacity;
  material.transparent = opacity < 1;
  material.depthWrite = opacity === 1;
  material.needsUpdate = true;
}
