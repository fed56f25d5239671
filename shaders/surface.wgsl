// The surface: vertex attributes to a lit colour. viewer/src/gpu/surface.rs.

// The mode's place in Mode::ALL. A pipeline has one mode, so that its shader is small.
override mode: u32 = 0u;

struct VertexIn {
    @location(0) position: vec3<i32>,
    @location(1) color: vec4<f32>,
    @location(2) normal: vec2<f32>,
}

// A scalar per vertex: value times has, and has; 0 where there is none.
struct ScalarIn {
    @location(3) scalar: vec2<f32>,
}

struct VertexOut {
    @invariant @builtin(position) clip: vec4<f32>,
    // Linear; alpha 0 where the model has no colours.
    @location(0) color: vec4<f32>,
    @location(1) normal: vec3<f32>,
    @location(2) from_cell: vec3<f32>,
    @location(3) scalar: vec2<f32>,
}

fn transformed(in: VertexIn, scalar: vec2<f32>) -> VertexOut {
    var out: VertexOut;
    out.from_cell = steps_from_cell(in.position);
    out.clip = frame.clip_from_cell * vec4<f32>(out.from_cell, 1.0);
    out.color = vec4<f32>(linear_from_srgb(in.color.rgb), in.color.a);
    out.normal = direction_from_octahedral(in.normal);
    out.scalar = scalar;
    return out;
}

@vertex
fn vertex(in: VertexIn) -> VertexOut {
    return transformed(in, vec2<f32>(0.0));
}

@vertex
fn vertex_scalar(in: VertexIn, also: ScalarIn) -> VertexOut {
    return transformed(in, also.scalar);
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

// Viridis in sRGB values; viewer/src/colormap.rs has the same stops.
fn viridis_stop(k: i32) -> vec3<f32> {
    switch k {
        case 0: {
            return vec3<f32>(68.0, 1.0, 84.0);
        }
        case 1: {
            return vec3<f32>(71.0, 44.0, 122.0);
        }
        case 2: {
            return vec3<f32>(59.0, 81.0, 139.0);
        }
        case 3: {
            return vec3<f32>(44.0, 113.0, 142.0);
        }
        case 4: {
            return vec3<f32>(33.0, 144.0, 141.0);
        }
        case 5: {
            return vec3<f32>(39.0, 173.0, 129.0);
        }
        case 6: {
            return vec3<f32>(92.0, 200.0, 99.0);
        }
        case 7: {
            return vec3<f32>(170.0, 220.0, 50.0);
        }
        default: {
            return vec3<f32>(253.0, 231.0, 37.0);
        }
    }
}

fn viridis(share: f32) -> vec3<f32> {
    let at = clamp(share, 0.0, 1.0) * 8.0;
    let low = min(i32(at), 7);
    return linear_from_srgb(mix(viridis_stop(low), viridis_stop(low + 1), at - f32(low)) / 255.0);
}

const NO_VALUE: vec3<f32> = vec3<f32>(0.2159, 0.2086, 0.1946);
const NEUTRAL: vec3<f32> = vec3<f32>(0.60, 0.57, 0.53);
const CUT_LINE: vec3<f32> = vec3<f32>(0.75, 0.13, 0.01);
const CUT_INSIDE: vec3<f32> = vec3<f32>(0.055, 0.085, 0.135);

fn lit(base: vec3<f32>, lamp: f32) -> vec3<f32> {
    return base * mix(1.0, 0.25 + 0.85 * lamp, frame.shading);
}

fn shade(in: VertexOut, front: bool) -> vec3<f32> {
    let to_eye = normalize(frame.eye_from_cell.xyz - in.from_cell * frame.eye_from_cell.w);
    let normal = normalize(in.normal) * select(-1.0, 1.0, front);
    let lamp = max(dot(normal, to_eye), 0.0);
    let has_color = in.color.a >= 0.5;
    // The colour that the modes of light shine on.
    var base = NEUTRAL;
    if frame.on_color == 1u && has_color {
        base = in.color.rgb;
    }
    let pixel = vec2<i32>(floor(in.clip.xy)) + frame.depth_normal_shift;
    var c: vec3<f32>;
    switch mode {
        case 1u: {
            c = clay(normal, to_eye);
        }
        case 2u: {
            c = base * (0.04 + 1.06 * lamp);
        }
        case 3u: {
            c = base * (0.05 + 0.02 * lamp + 1.25 * max(dot(normal, frame.rake.xyz), 0.0));
        }
        case 4u: {
            let bend = curvature(pixel, in.clip.z);
            c = base * (0.35 + 0.45 * lamp) * exp2(4.0 * frame.strength * bend / (0.4 + abs(bend)));
        }
        case 5u: {
            c = base * (0.55 + 0.45 * lamp) * exp2(-7.0 * frame.strength * eye_dome(pixel, in.clip.z));
        }
        case 6u: {
            c = linear_from_srgb(normal * 0.5 + 0.5);
        }
        case 7u, 8u: {
            let distance = dot(frame.plane.xyz, in.from_cell) + frame.plane.w;
            c = lit(viridis((distance - frame.range_low) * frame.range_scale), lamp);
        }
        case 9u: {
            c = NO_VALUE;
            if in.scalar.y > 0.5 {
                c = viridis((in.scalar.x / in.scalar.y - frame.scalar_low) * frame.scalar_scale);
            }
            c = lit(c, lamp);
        }
        case 10u: {
            c = level_color(draw.level) * (0.35 + 0.65 * lamp);
        }
        case 11u: {
            c = error_color(draw.error) * (0.45 + 0.55 * lamp);
        }
        default: {
            c = lit(in.color.rgb, lamp);
            if !has_color {
                c = clay(normal, to_eye);
            }
        }
    }
    // The inside of the surface: darker and cooler, so that a hole in a wall is not taken for a wall. Behind a cut it is what one
    // looks at, and gets a colour of its own.
    if !front {
        c = mix(c, c * vec3<f32>(0.50, 0.56, 0.68) + vec3<f32>(0.003, 0.005, 0.012), frame.back_tint);
        if frame.clip_flags != 0u {
            c = mix(c, CUT_INSIDE * (0.5 + 0.8 * lamp), 0.8 * frame.back_tint);
        }
    }
    return c;
}

@fragment
fn fragment(in: VertexOut, @builtin(front_facing) front: bool) -> @location(0) vec4<f32> {
    return vec4<f32>(shade(in, front), 1.0);
}

// With a cut, or while levels fade.
@fragment
fn fragment_cut(in: VertexOut, @builtin(front_facing) front: bool) -> @location(0) vec4<f32> {
    let inside = clip_depth(in.from_cell);
    // Pixels from the cut. A surface along the cut has no line.
    let slope = length(vec2<f32>(dpdx(inside), dpdy(inside)));
    let pixels = inside / max(slope, 1e-6);
    let smoothed = frame.smooth_cut == 1u;
    if pixels < select(0.0, -0.5, smoothed) || fades_out(in.clip.xy) {
        discard;
    }
    var c = shade(in, front);
    if frame.clip_flags != 0u {
        c = mix(c, CUT_LINE, clamp(frame.outline + 0.5 - pixels, 0.0, 1.0));
    }
    return vec4<f32>(c, select(1.0, clamp(pixels + 0.5, 0.0, 1.0), smoothed));
}
