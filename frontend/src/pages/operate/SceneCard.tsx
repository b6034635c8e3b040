/** The actuator: flat, or in 3D by the same service behind the same sign-in. */

import { Button, Group } from "@mantine/core";
import { CameraChoice } from "../../components/CameraChoice";
import { Card } from "../../components/Card";
import { sceneAddress } from "../../components/cameras";
import { SceneFrame } from "../../components/SceneFrame";
import { paintsInSoftware } from "../../drawing/canvas";
import { useSceneView } from "../../service/useSceneView";
import { HUES, paintOf } from "../../theme/signals";
import { ActuatorDrawing } from "./ActuatorDrawing";
import styles from "./Operate.module.css";

export function SceneCard() {
  const { solid, camera, known, toggle, look } = useSceneView(true);
  return (
    <Card
      title="Actuator"
      className={styles.scene}
      aside={
        <Group gap={6} wrap="nowrap">
          {solid && <CameraChoice camera={camera} onChange={look} />}
          <Button
            size="compact-xs"
            variant="default"
            disabled={!known}
            title={
              !solid && paintsInSoftware()
                ? "This browser paints without a graphics processor: the 3D view will slow this page down."
                : ""
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
        <>
          <ActuatorDrawing />
          <p className={styles.fanKey}>
            <span style={{ background: paintOf(HUES.S) }} aria-hidden="true" /> deflection by ±2 N·m
          </p>
        </>
      )}
    </Card>
  );
}
