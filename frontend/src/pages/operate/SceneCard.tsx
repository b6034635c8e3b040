/** The actuator: flat, or in 3D by the same service behind the same sign-in. */

import { Button, Group } from "@mantine/core";
import { useState } from "react";
import { paintsInSoftware } from "../../charts/canvas";
import { CameraChoice } from "../../components/CameraChoice";
import { Card } from "../../components/Card";
import { sceneAddress } from "../../components/cameras";
import { SceneFrame } from "../../components/SceneFrame";
import { usePreferences } from "../../service/preferences";
import { ActuatorDrawing } from "./ActuatorDrawing";
import styles from "./Operate.module.css";

export function SceneCard() {
  // the 3D view shares this page's thread: without a graphics processor it would hold up STOP, so it is asked for there
  const { preferences, change } = usePreferences();
  const [here, setHere] = useState<boolean | null>(null);
  const [camera, setCamera] = useState("Front");
  const solid = here ?? (!paintsInSoftware() && (preferences.solid ?? true));

  function toggle(): void {
    setHere(!solid);
    change({ solid: !solid });
  }

  return (
    <Card
      title="Actuator"
      className={styles.scene}
      aside={
        <Group gap={6} wrap="nowrap">
          {solid && <CameraChoice camera={camera} onChange={setCamera} />}
          <Button
            size="compact-xs"
            variant="default"
            title={
              solid
                ? ""
                : "This browser paints without a graphics processor: the 3D view will slow this page down."
            }
            onClick={toggle}
          >
            {solid ? "Show flat" : "Show in 3D"}
          </Button>
        </Group>
      }
    >
      {solid ? (
        <SceneFrame address={sceneAddress("./scene/", camera)} title="3D view" />
      ) : (
        <ActuatorDrawing />
      )}
    </Card>
  );
}
