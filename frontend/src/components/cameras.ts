/** Where the 3D view can be looked at from. Pure. In the scene's units: ten to the metre, z up, the joint at the origin. */

interface Camera {
  readonly name: string;
  readonly position: readonly [number, number, number];
  readonly lookAt: readonly [number, number, number];
}

export const CAMERAS: readonly Camera[] = [
  { name: "Front", position: [1.6, -10.2, 1], lookAt: [0, 0, -0.48] },
  { name: "Side", position: [9.5, -3.4, 0.4], lookAt: [0, 0, -0.6] },
  { name: "Above", position: [1.2, -6.4, 8], lookAt: [0, 0, -0.4] },
  { name: "Joint", position: [0.6, -4.6, 1.2], lookAt: [0, 0, 0.4] },
  { name: "Springs", position: [0.4, -5, -1.4], lookAt: [0, 0, -1.9] },
];

/** The address of the 3D view, at `path`, seen by the camera of this name. */
export function sceneAddress(path: string, name: string): string {
  const camera = CAMERAS.find((one) => one.name === name) ?? CAMERAS[0];
  if (camera === undefined) return path;
  const { position, lookAt } = camera;
  return `${path}?initialCameraPosition=${position.join(",")}&initialCameraLookAt=${lookAt.join(",")}`;
}
