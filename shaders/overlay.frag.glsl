#version 330
// A picture over the whole viewport; its rows begin at the top.
uniform sampler2D picture;
in vec2 uv;
out vec4 color;

void main() {
    color = texture(picture, uv);
}
