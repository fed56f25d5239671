// Depth and normal of every pixel, for modes that look at its neighbourhood; drawn before the surface. viewer/src/gpu/depth_normal.rs.
// Two unsigned integers: the bits of the depth (0: nothing there), and the normal in octahedral coordinates, 16 bits each.
// Integers, because every WebGL2 can draw into them and read them back exactly.

struct ReliefOut {
    @invariant @builtin(position) clip: vec4<f32>,
    @location(0) normal: vec3<f32>,
    @location(1) from_cell: vec3<f32>,
}

@vertex
fn vertex(@location(0) position: vec3<i32>, @location(2) normal: vec2<f32>) -> ReliefOut {
    var out: ReliefOut;
    out.from_cell = steps_from_cell(position);
    out.clip = frame.clip_from_cell * vec4<f32>(out.from_cell, 1.0);
    out.normal = direction_from_octahedral(normal);
    return out;
}

fn texel(in: ReliefOut, front: bool) -> vec2<u32> {
    let n = normalize(in.normal) * select(-1.0, 1.0, front);
    return vec2<u32>(bitcast<u32>(in.clip.z), packed_from_direction(n));
}

@fragment
fn fragment(in: ReliefOut, @builtin(front_facing) front: bool) -> @location(0) vec2<u32> {
    return texel(in, front);
}

@fragment
fn fragment_cut(in: ReliefOut, @builtin(front_facing) front: bool) -> @location(0) vec2<u32> {
    if clip_depth(in.from_cell) < 0.0 || fades_out(in.clip.xy + vec2<f32>(-frame.depth_normal_shift)) {
        discard;
    }
    return texel(in, front);
}
