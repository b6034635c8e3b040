import {
  ActionIcon,
  Button,
  type MantineColorScheme,
  Menu,
  Tooltip,
  useMantineColorScheme,
} from "@mantine/core";
import { useState } from "react";
import { TbBell, TbBellOff, TbDeviceDesktop, TbKeyboard, TbMoon, TbSun } from "react-icons/tb";
import { age_ms, health, type Link } from "../live/link";
import { useLive, useNow, useSampleAge } from "../live/react";
import { age, capital, fixed, kilohertz } from "../samples/format";
import { fillText } from "../samples/texts";
import { usePreferences } from "../service/api/preferences";
import { useMayCommand } from "../service/control/control";
import type { ControlForm } from "../service/control/handover";
import {
  askForPermission,
  notificationAccess,
  playTone,
  whyNotNotified,
} from "../service/notifications/notifications";
import type { PlantView } from "../wire/types";
import badgeStyles from "./Badge.module.css";
import { ControlMenu } from "./ControlMenu";
import { Explained, Terms } from "./Explained";
import headerStyles from "./Header.module.css";
import notificationMenuStyles from "./NotificationMenu.module.css";
import { TEXTS } from "./texts";
import { Metric } from "./values";

/** State of the connection and age of its data. */

function LinkStatus({ link, now_ms }: { link: Link; now_ms: number }) {
  const condition = health(link, now_ms);
  const old = age_ms(link, now_ms);
  const value = {
    live: link.latency_ms === null ? TEXTS.linkConnected : age(link.latency_ms),
    stale: old === null ? TEXTS.linkStale : fillText(TEXTS.linkStaleFor, { age: age(old) }),
    down: old === null ? TEXTS.linkConnecting : fillText(TEXTS.linkDownFor, { age: age(old) }),
  }[condition];
  return (
    <span role="status" aria-label={TEXTS.link} data-health={condition} style={{ display: "flex" }}>
      <Metric of="timing:latency_ms" value={value} width="11ch" />
    </span>
  );
}

/** Switches for notifications and sounds while the page is in the background. */

export function NotificationMenu() {
  const { preferences, change } = usePreferences();
  const [answer, setAnswer] = useState(notificationAccess);
  const [wasRequested, setRequested] = useState(false);
  const on = preferences.notify && answer === "granted";
  const Icon = on || preferences.sound ? TbBell : TbBellOff;

  async function toggle(): Promise<void> {
    if (on) {
      change({ notify: false });
      return;
    }
    const permission = await askForPermission();
    setAnswer(permission);
    setRequested(true);
    if (permission === "granted") change({ notify: true });
  }

  function toggleSound(): void {
    if (!preferences.sound) void playTone();
    change({ sound: !preferences.sound });
  }

  const refused = answer === "default" && !preferences.notify && !wasRequested ? "" : whyNotNotified(answer);
  return (
    <Menu
      position="bottom-end"
      width={300}
      closeOnItemClick={false}
      withInitialFocusPlaceholder={false}
      onOpen={() => setAnswer(notificationAccess())}
    >
      <Menu.Target>
        <ActionIcon
          variant="subtle"
          color="gray"
          aria-label={TEXTS.notifications}
          title={fillText(TEXTS.notificationsState, {
            notifications: on ? TEXTS.on : TEXTS.off,
            sound: preferences.sound ? TEXTS.on : TEXTS.off,
          })}
        >
          <Icon size={18} />
        </ActionIcon>
      </Menu.Target>
      <Menu.Dropdown>
        <Menu.CheckboxItem checked={on} onChange={() => void toggle()}>
          {TEXTS.notifications}
        </Menu.CheckboxItem>
        <Menu.CheckboxItem checked={preferences.sound} onChange={toggleSound}>
          {TEXTS.sound}
        </Menu.CheckboxItem>
        <p className={notificationMenuStyles.note}>{TEXTS.notificationsHint}</p>
        {refused !== "" && (
          <output aria-label={TEXTS.notificationsHere} className={notificationMenuStyles.note}>
            {refused}
          </output>
        )}
      </Menu.Dropdown>
    </Menu>
  );
}

/** Badge of the plant, on every page: shows whether real hardware may move. */

/** Short names by kind; a plant of a package has its own name. */
const SHORT: Partial<Record<PlantView["kind"], string>> = {
  simulator: TEXTS.simulator,
  rig: TEXTS.rig,
  virtual_card: TEXTS.virtualCard,
  replay: TEXTS.replay,
};

/** A plant of a package is treated as real, because its hardware is unknown. */
const MAY_BE_REAL: readonly PlantView["kind"][] = ["rig", "package"];

/** Text of the badge for a plant's stored name, with its kind: whether real hardware moved. */
export function plantWord(name: string): string {
  const kinds: Readonly<Record<string, string>> = SHORT;
  const word = kinds[name.replaceAll(" ", "_")];
  return word === undefined ? name : fillText(TEXTS.plantWord, { kind: word, name });
}

interface PlantBadgeProps {
  readonly plant: PlantView | undefined;
  readonly parameters: string | undefined;
}

export function PlantBadge({ plant, parameters }: PlantBadgeProps) {
  if (plant === undefined) {
    return (
      <span
        className={badgeStyles.badge}
        role="img"
        aria-label={TEXTS.plantUnknown}
        title={TEXTS.plantUnknown}
      >
        ···
      </span>
    );
  }
  const name = capital(plant.name);
  return (
    <span
      className={badgeStyles.badge}
      data-real={MAY_BE_REAL.includes(plant.kind)}
      role="img"
      aria-label={name}
      title={fillText(TEXTS.plantParameters, {
        plant: capital(plant.says) || name,
        parameters: parameters ?? TEXTS.unknown,
      })}
    >
      {SHORT[plant.kind] ?? plant.name}
    </span>
  );
}

/** Switch for the person's unit of angles on all pages. */

const NAMES = { deg: TEXTS.degrees, rad: TEXTS.radians } as const;
const SIGNS = { deg: "°", rad: "rad" } as const;

function AngleSwitch() {
  const { preferences, change } = usePreferences();
  const other = preferences.angles === "deg" ? "rad" : "deg";
  return (
    <Button
      variant="subtle"
      color="gray"
      size="compact-sm"
      aria-label={fillText(TEXTS.anglesIn, {
        unit: NAMES[preferences.angles],
        choices: `${SIGNS.deg} / ${SIGNS.rad}`,
      })}
      title={fillText(TEXTS.anglesHint, { unit: NAMES[preferences.angles], other: NAMES[other] })}
      onClick={() => change({ angles: other })}
      px={4}
      fw={400}
    >
      {(["deg", "rad"] as const).map((unit, index) => (
        <span key={unit}>
          {index > 0 && "\u00a0/\u00a0"}
          {unit === preferences.angles ? <strong>{SIGNS[unit]}</strong> : SIGNS[unit]}
        </span>
      ))}
    </Button>
  );
}

/** Header of every page: plant, mode, timing of the control loop, connection and control. STOP is separate. */

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
    <header className={headerStyles.header}>
      <span className={headerStyles.brand}>
        <img src="./sinew.svg" alt="" width="24" height="24" />
        {TEXTS.brand}
      </span>
      <PlantBadge plant={state?.plant} parameters={state?.parameters} />
      {useMayCommand() === false && (
        <span className={badgeStyles.badge} role="img" aria-label={TEXTS.viewerName} title={TEXTS.viewerHint}>
          {TEXTS.viewer}
        </span>
      )}
      <Terms>
        <span
          className={headerStyles.mode}
          role="status"
          aria-label={TEXTS.mode}
          data-mode={state?.mode}
          data-stale={stale}
          title={old_s === null ? undefined : fillText(TEXTS.lastKnown, { age: age(1000 * old_s) })}
        >
          <span className={headerStyles.dot} aria-hidden="true" />
          <Explained of={`mode:${state?.mode}`} quiet>
            {state?.mode ?? TEXTS.unknown}
          </Explained>
        </span>
        {/* biome-ignore lint/a11y/useSemanticElements: a fieldset is for inputs, these are readings */}
        <div className={headerStyles.metrics} role="group" aria-label={TEXTS.loopTiming} data-stale={stale}>
          <Metric
            of="timing:rate_Hz"
            value={timing ? kilohertz(timing.rate_Hz) : TEXTS.unknown}
            width="9ch"
          />
          <Metric
            of="timing:lateness_p99_ms"
            value={timing ? `${fixed(timing.lateness_p99_ms, 2)} ms` : TEXTS.unknown}
            width="8ch"
          />
          <Metric
            of="timing:overruns"
            value={timing ? fixed(timing.overruns, 0) : TEXTS.unknown}
            width="8ch"
          />
          <LinkStatus link={link} now_ms={now_ms} />
        </div>
      </Terms>
      <div className={headerStyles.tools}>
        <ControlMenu onName={onName} onForm={onForm} />
        <AngleSwitch />
        <NotificationMenu />
        <SchemeMenu />
        <Tooltip label={TEXTS.shortcutsHint}>
          <ActionIcon variant="subtle" color="gray" aria-label={TEXTS.shortcuts} onClick={onShortcuts}>
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
        <ActionIcon variant="subtle" color="gray" aria-label={TEXTS.colourScheme} title={TEXTS.colourScheme}>
          <Current size={18} />
        </ActionIcon>
      </Menu.Target>
      <Menu.Dropdown>
        <Menu.Item leftSection={<TbSun size={16} />} onClick={() => choose("light")}>
          {TEXTS.light}
        </Menu.Item>
        <Menu.Item leftSection={<TbMoon size={16} />} onClick={() => choose("dark")}>
          {TEXTS.dark}
        </Menu.Item>
        <Menu.Item leftSection={<TbDeviceDesktop size={16} />} onClick={() => choose("auto")}>
          {TEXTS.system}
        </Menu.Item>
      </Menu.Dropdown>
    </Menu>
  );
}
