// Draws views with WebGL2: one context off the page, whose pictures are copied to the views.

function compiled(gl, vertex, fragment) {
  const program = gl.createProgram();
  for (const [kind, source] of [
    [gl.VERTEX_SHADER, vertex],
    [gl.FRAGMENT_SHADER, fragment],
  ]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) {
    const logs = gl.getAttachedShaders(program).map((shader) => gl.getShaderInfoLog(shader));
    throw new Error(`shader: ${logs.join(" ")} ${gl.getProgramInfoLog(program)}`);
  }
  return new Proxy(
    { program },
    {
      get: (held, name) => held[name] ?? (held[name] = gl.getUniformLocation(program, name)),
    },
  );
}

class Renderer {
  // Throws where there is no WebGL2.
  constructor(onLost) {
    this.canvas = document.createElement("canvas");
    const gl = this.canvas.getContext("webgl2", { antialias: true, alpha: true });
    if (!gl) throw new Error("this browser has no WebGL2, or it is turned off");
    this.canvas.addEventListener("webglcontextlost", onLost);
    this.gl = gl;
    this.faces = compiled(gl, FACE_VERTEX, FACE_FRAGMENT);
    this.lines = compiled(gl, LINE_VERTEX, PLAIN_FRAGMENT);
    this.triangles = compiled(gl, TRIANGLE_VERTEX, PLAIN_FRAGMENT);
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  }

  // An array of vertices: `fields` are [how many numbers, type, byte], `divisor` 1 for instances.
  mesh(data, stride, fields, divisor) {
    const { gl } = this;
    const [array, buffer] = [gl.createVertexArray(), gl.createBuffer()];
    gl.bindVertexArray(array);
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
    fields.forEach(([size, type, byte], location) => {
      gl.enableVertexAttribArray(location);
      if (type === gl.FLOAT) gl.vertexAttribPointer(location, size, type, false, stride, byte);
      else gl.vertexAttribIPointer(location, size, type, stride, byte);
      gl.vertexAttribDivisor(location, divisor);
    });
    return { array, buffer, count: data.byteLength / stride };
  }

  release(mesh) {
    if (!mesh) return;
    this.gl.deleteVertexArray(mesh.array);
    this.gl.deleteBuffer(mesh.buffer);
  }

  faceMesh({ bytes }) {
    const { gl } = this;
    const fields = [
      [3, gl.UNSIGNED_SHORT, 0],
      [4, gl.UNSIGNED_BYTE, 8],
    ];
    return this.mesh(bytes, FACE_BYTES, fields, 1);
  }

  lineMesh(lines, ratio) {
    const { gl } = this;
    const data = lines.flatMap(({ from, to, color, width }) => [
      ...from,
      ...to,
      ...color,
      width * ratio,
    ]);
    const fields = [
      [3, gl.FLOAT, 0],
      [3, gl.FLOAT, 12],
      [4, gl.FLOAT, 24],
    ];
    return this.mesh(new Float32Array(data), 40, fields, 1);
  }

  triangleMesh(triangles) {
    const { gl } = this;
    const data = triangles.flatMap(({ places, color }) =>
      places.flatMap((place) => [...place, ...color]),
    );
    return this.mesh(
      new Float32Array(data),
      24,
      [
        [3, gl.FLOAT, 0],
        [3, gl.FLOAT, 12],
      ],
      0,
    );
  }

  // Large enough for the largest view: one that shrank with each view would be made anew each time.
  begin(width, height) {
    const { canvas, gl } = this;
    if (canvas.width < width) canvas.width = width;
    if (canvas.height < height) canvas.height = height;
    gl.viewport(0, canvas.height - height, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  }

  drawFaces(mesh, lens, scene, palette, haze) {
    const { gl, faces } = this;
    const length = Math.hypot(...SUN);
    gl.useProgram(faces.program);
    gl.uniformMatrix4fv(faces.clipFromOcc, false, lens.clipFromOcc);
    gl.uniform3fv(faces.lower, scene.lower);
    gl.uniform1f(faces.voxel, scene.voxel);
    gl.uniform3fv(faces.palette, palette.flat());
    gl.uniform3fv(
      faces.sun,
      SUN.map((along) => along / length),
    );
    gl.uniform3fv(faces.haze, haze);
    gl.uniform2fv(faces.hazeFromTo, lens.hazeFromTo);
    gl.bindVertexArray(mesh.array);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, mesh.count);
  }

  drawLines(mesh, lens, size, opacity = 1) {
    const { gl, lines } = this;
    gl.useProgram(lines.program);
    gl.uniformMatrix4fv(lines.clipFromOcc, false, lens.clipFromOcc);
    gl.uniform2fv(lines.size, size);
    gl.uniform1f(lines.opacity, opacity);
    gl.bindVertexArray(mesh.array);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, mesh.count);
  }

  drawTriangles(mesh, lens) {
    const { gl, triangles } = this;
    gl.useProgram(triangles.program);
    gl.uniformMatrix4fv(triangles.clipFromOcc, false, lens.clipFromOcc);
    gl.uniform1f(triangles.opacity, 1);
    gl.bindVertexArray(mesh.array);
    gl.drawArrays(gl.TRIANGLES, 0, mesh.count);
  }

  // The parts that voxels hide, faintly.
  drawHiddenLines(mesh, lens, size, opacity = 0.3) {
    const { gl } = this;
    gl.depthFunc(gl.GREATER);
    gl.depthMask(false);
    this.drawLines(mesh, lens, size, opacity);
    gl.depthFunc(gl.LESS);
    gl.depthMask(true);
  }

  copyTo(context) {
    const { width, height } = context.canvas;
    context.clearRect(0, 0, width, height);
    context.drawImage(this.canvas, 0, 0, width, height, 0, 0, width, height);
  }
}
