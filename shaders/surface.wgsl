// The surface: vertex attributes to a lit colour. viewer/src/gpu/surface.rs.

struct VertexIn {
    @location(0) position: vec3<i32>,
    @location(1) color: vec4<f32>,
    @location(2) normal: vec2<f32>,
}

struct VertexOut {
    @invariant @builtin(position) clip: vec4<f32>,
    // Linear; alpha 0 where the model has no colours.
    @location(0) color: vec4<f32>,
    @location(1) normal: vec3<f32>,
    @location(2) from_cell: vec3<f32>,
}

// Octahedral coordinates to a direction (Meyer et al. 2010); snorm16 has mapped -32767..32767 to -1..1 already.
fn direction_from_octahedral(o: vec2<f32>) -> vec3<f32> {
    let z = 1.0 - abs(o.x) - abs(o.y);
    let fold = vec2<f32>(
        (1.0 - abs(o.y)) * select(-1.0, 1.0, o.x >= 0.0),
        (1.0 - abs(o.x)) * select(-1.0, 1.0, o.y >= 0.0),
    );
    return normalize(vec3<f32>(select(o, fold, z < 0.0), z));
}

@vertex
fn vertex(in: VertexIn) -> VertexOut {
    var out: VertexOut;
    out.from_cell = steps_from_cell(in.position);
    out.clip = frame.clip_from_cell * vec4<f32>(out.from_cell, 1.0);
    out.color = vec4<f32>(linear_from_srgb(in.color.rgb), in.color.a);
    out.normal = direction_from_octahedral(in.normal);
    return out;
}

// A warm stone under a sky, a key light and a lamp at the eye.
fn clay(normal: vec3<f32>, to_eye: vec3<f32>) -> vec3<f32> {
    let ground = vec3<f32>(0.085, 0.074, 0.065);
    let sky = vec3<f32>(0.190, 0.195, 0.204);
    let ambient = mix(ground, sky, 0.5 + 0.5 * normal.z);
    let key = 0.50 * max(dot(normal, frame.light.xyz), 0.0);
    let lamp = 0.13 * max(dot(normal, to_eye), 0.0);
    return vec3<f32>(0.86, 0.80, 0.72) * (ambient + vec3<f32>(key + lamp));
}

// Neighbouring levels get hues that are far apart.
fn level_color(level: u32) -> vec3<f32> {
    let hue = fract(f32(level) * 0.381966);
    return 0.42 + 0.34 * cos(6.2831853 * (vec3<f32>(0.0, 0.33, 0.67) + hue));
}

// Pale limestone where the surface is the finest; then yellow, ochre, red, nearly black.
fn error_color(metres: f32) -> vec3<f32> {
    if metres <= 0.0 {
        return vec3<f32>(0.70, 0.68, 0.62);
    }
    let t = clamp((log2(metres) - frame.error_low) / (frame.error_high - frame.error_low), 0.0, 1.0) * 3.0;
    let yellow = vec3<f32>(0.87, 0.72, 0.25);
    let ochre = vec3<f32>(0.75, 0.32, 0.05);
    let red = vec3<f32>(0.42, 0.03, 0.02);
    let black = vec3<f32>(0.06, 0.005, 0.02);
    if t < 1.0 {
        return mix(yellow, ochre, t);
    }
    if t < 2.0 {
        return mix(ochre, red, t - 1.0);
    }
    return mix(red, black, t - 2.0);
}

@fragment
fn fragment(in: VertexOut, @builtin(front_facing) front: bool) -> @location(0) vec4<f32> {
    let to_eye = normalize(frame.eye_from_cell.xyz - in.from_cell * frame.eye_from_cell.w);
    let normal = normalize(in.normal) * select(-1.0, 1.0, front);
    let lamp = max(dot(normal, to_eye), 0.0);
    var c: vec3<f32>;
    switch frame.mode {
        case 1u: {
            c = clay(normal, to_eye);
        }
        case 2u: {
            c = linear_from_srgb(normal * 0.5 + 0.5);
        }
        case 3u: {
            c = level_color(draw.level) * (0.35 + 0.65 * lamp);
        }
        case 4u: {
            c = error_color(draw.error) * (0.45 + 0.55 * lamp);
        }
        default: {
            c = in.color.rgb * mix(1.0, 0.25 + 0.85 * lamp, frame.shading);
            if in.color.a < 0.5 {
                c = clay(normal, to_eye);
            }
        }
    }
    // The inside of the surface: darker and cooler, so that a hole in a wall is not taken for a wall.
    if !front {
        c = mix(c, c * vec3<f32>(0.50, 0.56, 0.68) + vec3<f32>(0.003, 0.005, 0.012), frame.back_tint);
    }
    return for_target(vec4<f32>(c, 1.0));
}
