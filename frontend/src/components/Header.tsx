/** What has to be in sight on every page: which plant, which mode, how the loop and the link do, and STOP. */

import { ActionIcon, type MantineColorScheme, Menu, Tooltip, useMantineColorScheme } from "@mantine/core";
import { TbDeviceDesktop, TbKeyboard, TbMoon, TbSun } from "react-icons/tb";
import { health } from "../live/link";
import { useLive, useNow, useSampleAge } from "../live/react";
import { age, fixed, kilohertz } from "../samples/format";
import type { ControlForm } from "../service/handOver";
import { usePreferences } from "../service/preferences";
import { useMayCommand } from "../service/useMayCommand";
import { AngleSwitch } from "./AngleSwitch";
import badge from "./Badge.module.css";
import { ControlMenu } from "./ControlMenu";
import { Explained } from "./Explained";
import styles from "./Header.module.css";
import { LinkStatus } from "./LinkStatus";
import { Metric } from "./Metric";
import { NotificationMenu } from "./NotificationMenu";
import { PlantBadge } from "./PlantBadge";
import { Terms } from "./Terms";

interface HeaderProps {
  onShortcuts(): void;
  onName(): void;
  onForm(form: ControlForm): void;
}

export function Header({ onShortcuts, onName, onForm }: HeaderProps) {
  const state = useLive((live) => live.state);
  const link = useLive((live) => live.link);
  const isStateCurrent = useLive((live) => live.isStateCurrent);
  const now_ms = useNow(250);
  const old_s = useSampleAge();
  const stale = old_s !== null || health(link, now_ms) !== "live" || !isStateCurrent;
  const timing = state?.timing;
  return (
    <header className={styles.header}>
      <span className={styles.brand}>
        <img src="./sinew.svg" alt="" width="24" height="24" />
        Sinew
      </span>
      <PlantBadge plant={state?.plant} parameters={state?.parameters} />
      {useMayCommand() === false && (
        <span className={badge.badge} role="img" aria-label="Viewer" title="You look on, and may press STOP">
          VIEW
        </span>
      )}
      <Terms>
        <span
          className={styles.mode}
          role="status"
          aria-label="Mode"
          data-mode={state?.mode}
          data-stale={stale}
          title={old_s === null ? undefined : `as it was ${age(1000 * old_s)} ago`}
        >
          <span className={styles.dot} aria-hidden="true" />
          <Explained of={`mode:${state?.mode}`} quiet>
            {state?.mode ?? "unknown"}
          </Explained>
        </span>
        {/* biome-ignore lint/a11y/useSemanticElements: a fieldset is for inputs, these are readings */}
        <div className={styles.metrics} role="group" aria-label="Loop timing" data-stale={stale}>
          <Metric of="timing:rate_Hz" value={timing ? kilohertz(timing.rate_Hz) : "unknown"} width="9ch" />
          <Metric
            of="timing:lateness_p99_ms"
            value={timing ? `${fixed(timing.lateness_p99_ms, 2)} ms` : "unknown"}
            width="8ch"
          />
          <Metric of="timing:overruns" value={timing ? fixed(timing.overruns, 0) : "unknown"} width="8ch" />
          <LinkStatus link={link} now_ms={now_ms} />
        </div>
      </Terms>
      <div className={styles.tools}>
        <ControlMenu onName={onName} onForm={onForm} />
        <AngleSwitch />
        <NotificationMenu />
        <SchemeMenu />
        <Tooltip label="Keyboard shortcuts (?)">
          <ActionIcon variant="subtle" color="gray" aria-label="Keyboard shortcuts" onClick={onShortcuts}>
            <TbKeyboard size={18} />
          </ActionIcon>
        </Tooltip>
      </div>
    </header>
  );
}

function SchemeMenu() {
  const { colorScheme, setColorScheme } = useMantineColorScheme();
  const { change } = usePreferences();
  function choose(scheme: MantineColorScheme): void {
    setColorScheme(scheme);
    change({ scheme });
  }
  const icons = { light: TbSun, dark: TbMoon, auto: TbDeviceDesktop };
  const Current = icons[colorScheme];
  return (
    <Menu position="bottom-end" width={140}>
      <Menu.Target>
        <ActionIcon variant="subtle" color="gray" aria-label="Colour scheme" title="Colour scheme">
          <Current size={18} />
        </ActionIcon>
      </Menu.Target>
      <Menu.Dropdown>
        <Menu.Item leftSection={<TbSun size={16} />} onClick={() => choose("light")}>
          Light
        </Menu.Item>
        <Menu.Item leftSection={<TbMoon size={16} />} onClick={() => choose("dark")}>
          Dark
        </Menu.Item>
        <Menu.Item leftSection={<TbDeviceDesktop size={16} />} onClick={() => choose("auto")}>
          System
        </Menu.Item>
      </Menu.Dropdown>
    </Menu>
  );
}
