// What stands around the voxels, in the colours of the page: floor, UAV, and the camera's pyramid.

class Stage {
  constructor(renderer, box) {
    this.renderer = renderer;
    this.box = box;
    this.meshes = {};
  }

  color(name) {
    const hex = getComputedStyle(this.box).getPropertyValue(`--${name}`).trim();
    return [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16) / 255);
  }

  // For a scene, or again for other colours.
  build(scene, ratio) {
    const { renderer } = this;
    const [plumb, uav, rotor] = ["plumb", "uav", "rotor"].map((name) => this.color(name));
    const figure = uavFigure(scene, { plumb, uav, rotor });
    const lens = scene.frustum ? frustumLines(scene.frustum, this.color("lens")) : [];
    Object.values(this.meshes).forEach((mesh) => renderer.release(mesh));
    this.meshes = {
      floor: renderer.lineMesh(floorLines(scene, this.color("floor")), ratio),
      arms: renderer.lineMesh(figure.lines, ratio),
      discs: renderer.triangleMesh(figure.triangles),
      lens: renderer.lineMesh(lens, ratio),
    };
    this.colors = { haze: this.color("stage"), mark: this.color("mark") };
  }

  // From within the UAV it is not drawn, and the pyramid is the frame of the image.
  draw(lens, size) {
    const { renderer, meshes } = this;
    renderer.drawLines(meshes.floor, lens, size);
    if (!lens.isCamera) {
      renderer.drawTriangles(meshes.discs, lens);
      renderer.drawLines(meshes.arms, lens, size);
    }
    renderer.drawHiddenLines(meshes.lens, lens, size, lens.isCamera ? 1 : 0.3);
    renderer.drawLines(meshes.lens, lens, size);
  }
}
