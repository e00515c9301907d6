// The structs that host and kernels share. clshade/pipeline/struct_layout.py makes NumPy types of them, which are aligned as C
// says, and puts them, after its constants, before every program. A `real` is float, or double with DOUBLE; without float64 on
// the device members of type ulong hold the bits of doubles. tests/pipeline/test_layout.py compares sizes and offsets.

typedef struct {
    ulong needs; // as of Image
    double eye[3]; // world space
    double axes[9]; // rows: camera x, y, z in world space
    double principal[2]; // where the viewing direction meets the image, fractions of N and M
    double focal; // scene units
    double plane_width, plane_height; // W and H, scene units
    double columns, rows; // N and M, of the whole image if a part of one is drawn
    double guarded[2]; // lower left corner of the region that the guard band surrounds, column and row
    double first[2]; // column and row of the drawn part's lower left pixel, in 1/65536 px
    double near; // scene units
    double scale; // power of two that brings eye-relative positions to about 1
} View;

typedef struct {
    double depth; // camera z, scene units
    int x, y; // snapped, 1/65536 px, y up; meaningless before the near plane
    real w, w_low; // 1/depth, scaled; orthographic: minus the scaled depth; w_low: what rounding leaves of w
} Vertex;

typedef struct {
    int x[3], y[3]; // snapped corners, 1/65536 px, y up
    real w[3]; // 1/depth of the corners, scaled
    int piece_and_turn; // 2 * p + 1 if clockwise, else 2 * p; p: its clipped piece, -1 for a whole face
    int face; // index in the scene's face order
    real inverse_area; // 2^16 over twice the area in (1/65536 px)^2
} Triangle;

typedef struct {
    ulong box; // 16 bits each, lowest first: first column, first row, last column, last row with a sample
    real nearest; // the largest w of the corners
    real pad;
} Bounds;

typedef struct {
    real nearest; // the largest w of its corners
    int index; // of the triangle
    int box; // within the tile, 8 bits each: first column, first row, last column, last row
} Entry;

typedef struct {
    double key_depth; // the depth it is sorted by, scene units
    real w[3], w_low[3]; // 1/depth of the piece's corners, scaled, and what rounding leaves of it
    int x[3], y[3]; // snapped corners, 1/65536 px, y up
    int face; // index in the scene's face order
    real weights[9], weights_low[9]; // row j: the piece's corner j as a mean of the face's corners
    real uv[6], uv_low[6]; // texture coordinates of the corners: u, v, u, v, u, v
} Piece;

typedef struct {
    double rows[12]; // of its placement: three of the matrix, each with its shift
    double scale; // a power of two that brings the matrix to about 1
    int plain; // whether the placement is the identity
    int mirrored; // whether it mirrors
    int first_vertex, first_face; // of its mesh
    int face_shift; // from its mesh's faces to the scene's, modulo 2^32
    int number; // of the layer instance_id
} Instance;

typedef struct { // zeros are a plain point
    real position[3]; // relative to the eye, world axes, scaled; directional: unit, toward the light
    real directional; // 1 for a directional light, else 0
    real intensity[3]; // linear RGB; attenuated: at a scaled distance of 1
    real inverse_range; // 1/range, scaled; 0 for none
    real axis[3]; // unit, world axes: of the cone, away from the light; or of a light of finite size
    real cone_cosine; // of the outer angle
    real cone_scale; // 1 over the difference of the inner and the outer cosine
    int cone; // whether it is a spot
    int attenuated; // whether it decreases with the square of the distance
    int points; // that stand for a light of finite size, 0 for none
    int sphere; // whether it is a sphere, else a rectangle whose normal is axis
    real right[3]; // scaled: half a side of a rectangle, or a radius of a sphere's disc with normal axis
    real up[3]; // scaled: half the other side, or the radius at right angles
    real shadow_scale; // turns right and up into the units of its ShadowLight; with SHADOWS
    real center_scale; // turns position into the units of right and up, a power of two, 1 or less
    int first_point[2], point_step[2]; // in the unit square, fractions of 2^32; the step leads from point to point
} Light;

typedef struct {
    float high[3]; // of its position relative to the casters' origin, in the units of shadows, times w
    float w; // 1, a smaller power of two for a distant light, 0 for a directional one: toward it
    float low[3]; // what rounding leaves of the position
    int pad;
} ShadowLight;

typedef struct {
    float start[3], start_low[3]; // where the rays begin, or with ORTHOGRAPHIC the center's, in the frame of shadows
    float along[3], along_low[3]; // direction of the center's ray
    float right[3], right_low[3]; // what 1/256 px to the right adds to along, with ORTHOGRAPHIC to start
    float up[3], up_low[3]; // what 1/256 px up adds
    int center[2]; // 1/256 px
    int pad[2];
} ShadowView;

typedef struct {
    int levels; // of nodes of a hierarchy, 0 without casters
    int first_node[MOST_HIERARCHY_LEVELS]; // of each level, the parents of leaves first
    int first_leaf;
} Casters;

typedef struct {
    real ambient[3]; // ka * Ia, linear RGB
    real n; // specular exponent
    int texture; // index of the texture, -1 for none
    real k[3 * TERMS]; // coefficients of Phong's terms, by TERM_*, linear RGB each
    int two_sided; // whether a side seen from behind is lit with its normal turned round
    real alpha_cutoff; // pixels with less alpha are left out, if it is tested
    int front_only; // whether only counter-clockwise triangles are drawn
    int alpha_texture; // index of the texture whose alpha counts, -1 for none
    real f90; // of the dielectric: its reflectance at grazing incidence
    real f0[3]; // of the dielectric: at normal incidence, per channel
    real metallic; // 0 to 1
    real diffuse[3]; // factor of the color in the diffuse term of shader pbr, per channel
    real roughness; // 0 to 1, GGX's alpha is its square
    real emission[3]; // linear RGB
    int maps[MAPS]; // by MAP_*, indices of textures, -1 for none
    real map_factors[MAPS]; // by MAP_*: `Map.factor`
    real opacity; // factor of alpha
    int alpha_tested; // whether alpha is tested
    int blends; // whether it is transparent: composited by alpha
    int alpha_pad[2];
} Material;

typedef struct {
    int offset[ENVIRONMENT_LEVELS]; // of each level's first texel in the table of radiance
    int side[ENVIRONMENT_LEVELS]; // texels a side without the border of one texel
    int pad[2];
    real irradiance[27]; // over pi: factors of x, y, z, xx, yy, zz, xy, yz, zx of the normal, linear RGB
    real pad2;
} Environment;

typedef struct {
    int offset[MOST_LEVELS]; // of each level's first texel in the texel buffer
    int width, height; // texels
    int wrap[2]; // WRAP_* along u and v
    int lookup; // LOOKUP_*
    int levels; // how many there are, 1 without mip-mapping
    int nearest; // whether the nearest texel is shown
    int uv_offset; // of its coordinates among those of all sets
    int alike; // the first texture with its size, wrap modes, lookup, filter and coordinates
} Texture;

typedef struct {
    ulong needs; // a bit for each feature that the frame needs, see features.clh
    int columns, rows; // N and M
    int first[2]; // column and row of the lower left pixel in the whole image of which this is a part
    int tiles_x, tiles; // tiles a row and in all
    int lights; // count
    int samples; // a pixel; with SAMPLES
    int sample_x[MOST_SAMPLES], sample_y[MOST_SAMPLES]; // nearest to the center first, 1/65536 px from the pixel's corner
    int least[2], most[2]; // of sample_x and of sample_y
    int transparent; // whether there is no background
    int streamed; // whether pixels are written past the caches: rows must begin at multiples of 64 bytes
    int list_capacity; // entries that the tile lists have room for
    int map_colors; // colors of the color map from its low end to its high one; with SCALARS
    int unlit; // whether colors are taken as they are, shader nolight, where they are lit nonetheless
    int backdrop_columns, backdrop_rows; // pixels of the environment that is the background; with BACKDROP
    int ray_center[2]; // where the viewing direction meets the image, 1/256 px
    real background[3]; // linear RGB
    real unscale; // turns a scaled depth into scene units
    real light_unit; // what light is counted in: a power of two
    real layer_alpha; // the alpha from which on layers show a transparent triangle
    real to_eye[3]; // unit, world axes: against the viewing direction
    real line_color[3]; // linear RGB; with LINES
    real marked_color[3]; // of lines along edges of more than two faces
    real backdrop_unit; // what the table of the background is counted in: a power of two
    real ray_step[2]; // how far a ray turns to the right and up per 1/256 px, over the length of ray_axes
    real ray_offset[2]; // how far it is turned at ray_center
    real ray_axes[9]; // rows: the environment's front, left, top; columns: camera x, y, viewing direction
} Image;

typedef struct {
    double w[2]; // 1/depth of its ends, scaled; with painter's order minus the first rank of its faces
    double inset; // fraction of its length: its visibility is not asked nearer to an end
    int x[2], y[2]; // snapped ends, 1/256 px, y up
    int first_face; // index of the first of its faces in the faces of all edges
    int faces; // that contain the edge
    int marked; // whether they are more than two
    int pad;
} Line;

typedef struct {
    int cell_bits; // cells have 2^cell_bits/256 px a side
    int margin; // cells around the image, on each side, that lines may reach from
    int across; // cells a row, those of the margin included
    int up; // cells a column
    int width; // of the lines, 1/256 px
    int pad[3];
} LineGrid;

typedef struct {
    double nearest; // the largest w of its corners; with painter's order minus its rank
    int index; // of the triangle: a face, or the number of faces plus that of a clipped piece
    int low[2], high[2]; // least and largest x and y of its corners, 1/256 px
    int pad;
} Hider;

typedef struct {
    int visible; // triangles that may be seen
    int to_clip; // faces listed for the host to clip
    int behind; // faces wholly before the near plane
    int off_screen; // triangles whose box misses the image
    int between_samples; // triangles that cover no sample
    int zero_area; // triangles whose snapped corners lie on a line
    int back_facing; // triangles culled as seen from behind
    int next_tile; // the tile to be handed out next
    int saturated; // pixels with a color beyond what a real holds
    int empty_tiles; // tiles without entries, where there is a triangle at all
    ulong entries; // of all tile lists
    int pad[4];
} Counters;
