import { Button, NativeSelect } from "@mantine/core";
import { useEffect, useRef, useState } from "react";
import { canDrawSolid, paintsInSoftware } from "../drawing/canvas";
import { FramePacer, paceWindow } from "../drawing/pacer";
import { fillText } from "../samples/texts";
import { watchKeys } from "../stop/stop";
import styles from "./SceneFrame.module.css";
import { TEXTS } from "./texts";

/** Stage of a 3D view, and the text that is shown until it draws. */

/** Stages that backend/scene/proxy.py writes into its document, in order; the browser causes "dropped". */
const STAGES = ["connecting", "drawing", "shown", "lost", "dropped"] as const;

/** "page" before the document has loaded, "failed" if another document has loaded. */
type Stage = (typeof STAGES)[number] | "page" | "failed";

/** Waiting time after which the view reports a delay [s]. */
export const PATIENCE_S = 20;

const LOADING = {
  page: TEXTS.sceneLoadingPage,
  connecting: TEXTS.sceneLoadingData,
  drawing: TEXTS.sceneDrawing,
} as const;
const LATE = {
  page: TEXTS.sceneLatePage,
  connecting: TEXTS.sceneLateData,
  drawing: TEXTS.sceneLateDrawing,
} as const;

/** Stage in the document of a frame; "failed" for any other document, such as the browser's error page. */
function stageIn(frame: HTMLIFrameElement): Stage {
  const current = frame.contentDocument?.documentElement.dataset.stage;
  return STAGES.find((stage) => stage === current) ?? "failed";
}

/** Text of a stage; empty while the view draws. `software`: the browser renders without a GPU. */
function describeStage(stage: Stage, late: boolean, software: boolean): string {
  switch (stage) {
    case "shown":
      return "";
    case "failed":
      return TEXTS.sceneFailed;
    case "lost":
      return TEXTS.sceneLost;
    case "dropped":
      return TEXTS.sceneDropped;
  }
  if (late) return fillText(LATE[stage], { time: PATIENCE_S });
  return stage === "drawing" && software ? TEXTS.sceneDrawingSlowly : LOADING[stage];
}

/** 3D view of the service in a frame: shows its stage, receives the keys of STOP, and limits its share of time. */

/** Pause after a slow 3D frame, as a multiple of its duration, for the control loop and the charts. */
const REST = 4;

interface SceneFrameProps {
  /** Address with a query. */
  readonly address: string;
  readonly title: string;
}

export function SceneFrame({ address, title }: SceneFrameProps) {
  const [attempt, setAttempt] = useState(0);
  // Each attempt has its own address, because the browser's cached response may be the error.
  const frameAddress = attempt === 0 ? address : `${address}&attempt=${attempt}`;
  // A new camera loads a new document, so the view starts again.
  return (
    <View key={frameAddress} address={frameAddress} title={title} onAgain={() => setAttempt(attempt + 1)} />
  );
}

function View({ address, title, onAgain }: SceneFrameProps & { onAgain: () => void }) {
  const frame = useRef<HTMLIFrameElement>(null);
  const [stage, setStage] = useState<Stage>("page");
  const [late, setLate] = useState<Stage | null>(null);
  const [possible] = useState(canDrawSolid);

  useEffect(() => {
    const element = frame.current;
    if (element === null) return;
    let unwatch = () => {};
    const onMessage = (event: MessageEvent) => {
      if (event.source === element.contentWindow) setStage(stageIn(element));
    };
    const onLoad = () => {
      unwatch();
      const current = stageIn(element);
      setStage(current);
      if (current === "failed" || element.contentWindow === null) return;
      // While the 3D view has the focus, its own document receives the keys: STOP must listen there too.
      unwatch = watchKeys(element.contentWindow);
      paceWindow(element.contentWindow, new FramePacer(REST));
    };
    window.addEventListener("message", onMessage);
    element.addEventListener("load", onLoad);
    return () => {
      window.removeEventListener("message", onMessage);
      element.removeEventListener("load", onLoad);
      unwatch();
    };
  }, []);

  useEffect(() => {
    setLate(null);
    const timer = window.setTimeout(() => setLate(stage), PATIENCE_S * 1000);
    return () => window.clearTimeout(timer);
  }, [stage]);

  const text = possible ? describeStage(stage, late === stage, paintsInSoftware()) : TEXTS.sceneImpossible;
  const stuck = stage === "failed" || stage === "dropped" || (stage !== "shown" && late === stage);
  return (
    <div className={styles.frame}>
      <iframe ref={frame} src={address} title={title} className={styles.view} data-stage={stage} />
      <div className={styles.words} data-empty={text === ""}>
        {/* always present, so that screen readers announce a change */}
        <output aria-label={fillText(TEXTS.sceneStatus, { title })}>{text}</output>
        {possible && stuck && (
          <Button size="compact-xs" variant="default" onClick={onAgain}>
            {TEXTS.tryAgain}
          </Button>
        )}
      </div>
    </div>
  );
}

/** Cameras of the 3D view, in the scene's units: ten per metre, z up, the joint at the origin. Pure. */

interface Camera {
  /** Name stored in the preferences. */
  readonly name: string;
  readonly label: string;
  readonly position: readonly [number, number, number];
  readonly lookAt: readonly [number, number, number];
}

const CAMERAS: readonly Camera[] = [
  { name: "Front", label: TEXTS.cameraFront, position: [1.6, -10.2, 1], lookAt: [0, 0, -0.48] },
  { name: "Side", label: TEXTS.cameraSide, position: [9.5, -3.4, 0.4], lookAt: [0, 0, -0.6] },
  { name: "Above", label: TEXTS.cameraAbove, position: [1.2, -6.4, 8], lookAt: [0, 0, -0.4] },
  { name: "Joint", label: TEXTS.cameraJoint, position: [0.6, -4.6, 1.2], lookAt: [0, 0, 0.4] },
  { name: "Springs", label: TEXTS.cameraSprings, position: [0.4, -5, -1.4], lookAt: [0, 0, -1.9] },
];

/** Address of the 3D view at `path` with the camera of this name. */
export function sceneAddress(path: string, name: string): string {
  const camera = CAMERAS.find((one) => one.name === name) ?? CAMERAS[0];
  if (camera === undefined) return path;
  const { position, lookAt } = camera;
  return `${path}?initialCameraPosition=${position.join(",")}&initialCameraLookAt=${lookAt.join(",")}`;
}

/** Choice of the camera of a 3D view. */

export function CameraChoice({ camera, onChange }: { camera: string; onChange: (name: string) => void }) {
  return (
    <NativeSelect
      aria-label={TEXTS.camera}
      size="xs"
      value={camera}
      onChange={(event) => onChange(event.currentTarget.value)}
      data={CAMERAS.map(({ name, label }) => ({ value: name, label }))}
      styles={{ input: { height: 24, minHeight: 24 } }}
    />
  );
}
