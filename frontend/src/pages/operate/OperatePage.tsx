/** The operator's page: charts, 3D view, controls. */

import { OperatorsOnly } from "../../components/OperatorsOnly";
import { useLive } from "../../live/react";
import { TriggerCard } from "../system/TriggerCard";
import { CardJumps } from "./CardJumps";
import { ContactCard } from "./ContactCard";
import { DisturbanceCard } from "./DisturbanceCard";
import { LiveCharts } from "./LiveCharts";
import { MapCard } from "./MapCard";
import { ModeCard } from "./ModeCard";
import styles from "./Operate.module.css";
import { PlayerCard } from "./PlayerCard";
import { ReferencesCard } from "./ReferencesCard";
import { SceneCard } from "./SceneCard";
import { TuningCard } from "./TuningCard";
import { ViewOnly } from "./ViewOnly";
import { WallCard } from "./WallCard";

export function OperatePage() {
  const plays = useLive((live) => live.state?.plant.kind === "replay");
  return (
    <div className={styles.page}>
      <h1 className="visually-hidden">Operate</h1>
      <div className={styles.charts}>
        <LiveCharts />
      </div>
      <div className={styles.views}>
        <SceneCard />
        <MapCard />
      </div>
      <div className={styles.controls}>{plays ? <PlayerCard /> : <Controls />}</div>
    </div>
  );
}

/** What a plant is told; a viewer reads what is in force. */
function Controls() {
  return (
    <OperatorsOnly otherwise={<ViewOnly />}>
      <CardJumps />
      <ModeCard />
      <ReferencesCard />
      <TuningCard />
      <ContactCard />
      <DisturbanceCard />
      <WallCard />
      <TriggerCard />
    </OperatorsOnly>
  );
}
