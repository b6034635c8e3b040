/** From where a 3D view is looked at. */

import { NativeSelect } from "@mantine/core";
import { CAMERAS } from "./cameras";

export function CameraChoice({ camera, onChange }: { camera: string; onChange: (name: string) => void }) {
  return (
    <NativeSelect
      aria-label="Camera"
      size="xs"
      value={camera}
      onChange={(event) => onChange(event.currentTarget.value)}
      data={CAMERAS.map(({ name }) => name)}
      styles={{ input: { height: 24, minHeight: 24 } }}
    />
  );
}
